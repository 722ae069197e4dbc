"""Small tasks that the tests run on the CPU and, in a separate process, on a GPU or its simulator.

``python tests/gpu/device_tasks.py OUT NAME...`` runs the named tasks with CUDA (with the simulator, if the
environment selects it before numba is imported) and pickles their results to OUT.
"""

from __future__ import annotations

import dataclasses
import pickle
import sys
from pathlib import Path
from unittest.mock import patch

import numpy as np

from grainmotion.backends.device import Device, backend_of
from grainmotion.model.geometry import Geometry
from grainmotion.model.grains import GrainSet
from grainmotion.model.motions import Motions
from grainmotion.model.pose import Pose
from grainmotion.model.scan import Scan
from grainmotion.model.volume import Volume
from grainmotion.objective.data_term import Target, gaussian
from grainmotion.objective.normal_matrix import PatchNormalMatrix, normal_matrix
from grainmotion.objective.residual import StateProblem
from grainmotion.objective.response_parameters import ResponseModel
from grainmotion.projection.footprints import footprint_patches
from grainmotion.projection.grain_arrays import GrainArrays
from grainmotion.projection.grains import assemble, differentiate_in_place, project_patches, simulate_radiographs
from grainmotion.projection.volumes import back_project, project
from grainmotion.reconstruction import coarse_start, ordered_subsets
from grainmotion.reconstruction.reconstruct import ReconstructSettings, reconstruct
from grainmotion.rotations import rotation_matrix, rotation_vector
from grainmotion.segmentation.extraction import grains_from_labels
from grainmotion.tracking.track import TrackSettings, track

VOXEL = 0.1
SHAPE = (12, 11, 15)
CENTERS = ((4.5, 5.0, 5.0), (10.0, 5.5, 6.0))  # (x, y, z) in voxels


def geometry(views: int = 3, beam: str = "cone") -> Geometry:
    """Views whose detector just contains the sample; a pixel at the axis has the size of a voxel."""
    angles = np.linspace(0, 150, views)
    if beam == "parallel":
        return Geometry.parallel(angles, (16, 19), VOXEL)
    return Geometry.cone(angles, (16, 19), 4 * VOXEL, source_to_axis=20, source_to_detector=80)


def grains(precision: type = np.float32) -> GrainSet:
    """Two textured grains with diameters of about 6 voxels."""
    z, y, x = np.mgrid[: SHAPE[0], : SHAPE[1], : SHAPE[2]].astype(float)
    both = []
    for k, (x0, y0, z0) in enumerate(CENTERS):
        distance = np.sqrt((x - x0) ** 2 + ((y - y0) * (1.2 + 0.2 * k)) ** 2 + ((z - z0) / 1.1) ** 2)
        both.append(np.clip(3.3 - distance, 0, 1) * (1 + 0.3 * np.sin(1.3 * x + k) * np.cos(y - 0.7 * z)))
    labels = np.where(both[0] > both[1], 1, np.where(both[1] > 0, 2, 0))
    return grains_from_labels(Volume((both[0] + both[1]).astype(precision), VOXEL), labels, reach=0, finer=1)


def pose(count: int) -> Pose:
    """Random translations and rotations of the grains."""
    rng = np.random.default_rng(3)
    rotations = rotation_matrix(rng.uniform(-0.4, 0.4, (count, 3)))
    return Pose(VOXEL * rng.uniform(-0.8, 0.8, (count, 3)), rotations)


def patches(device: Device, precision: type, projector: str) -> dict:
    """Patches of moved grains: values, derivatives, filtered ones, radiographs, gradients and normal matrix."""
    arrays = GrainArrays.of(grains(precision)).on(backend_of(device))
    views, moved, kernel = geometry(), pose(2), gaussian(1.0).astype(precision)
    footprints = footprint_patches(arrays, moved, views, margin=len(kernel) - 1)
    rng = np.random.default_rng(5)
    images = rng.normal(size=(len(views), *views.shape)).astype(precision)
    valid = (rng.random(images.shape) > 0.1).astype(precision)
    values, jacobian = differentiate_in_place(arrays, moved, views, footprints, projector)
    plain = np.array(jacobian.derivatives)
    radiographs = assemble(values, footprints, views, jacobian.backend)
    unfiltered = jacobian.copy()
    jacobian.filter(valid, kernel)
    unfiltered.filter(valid, np.ones(1, precision))
    (gradients,) = jacobian.vjp([images])
    return {
        "values alone": project_patches(arrays, moved, views, footprints, projector),
        "values": np.array(values),
        "derivatives": plain,
        "filtered": np.array(jacobian.derivatives),
        "masked": np.array(unfiltered.derivatives),
        "radiographs": radiographs,
        "gradients": gradients,
        "spread": jacobian.images(rng.normal(size=(1, 2, 6)))[0],
        "product": PatchNormalMatrix(jacobian) @ rng.normal(size=12),
        "blocks": normal_matrix(jacobian).toarray(),
    }


def linearized(device: Device, **options: object) -> dict:
    """The normal equations of a state."""
    arrays = GrainArrays.of(grains()).on(backend_of(device))
    target = Target(scan(), np.zeros(scan().line_integrals.shape, np.float32), "trilinear", 0.8,
                    ResponseModel("global", "constant", 1), backend=backend_of(device), **options)  # fmt: skip
    linear = StateProblem(arrays, target).linearize(pose(2))
    return {
        "cost": np.array(linear.cost),
        "gradient": linear.gradient,
        "hessian": linear.hessian.toarray(),
        "border": linear.border,
        "corner": linear.corner,
    }


def truth() -> Motions:
    """True motions of the grains in the state."""
    still, moved = grains(), pose(2)
    motions = Motions.identity(still.labels, still.centers)
    return dataclasses.replace(
        motions, translations=0.5 * moved.translations, rotations=0.25 * rotation_vector(moved.matrices)
    )


def scan(views: int = 3) -> Scan:
    """Radiographs of that state."""
    return Scan(simulate_radiographs(grains(), truth(), geometry(views)), geometry(views))


def tracked(device: Device) -> dict:
    """Motions of the tracked state."""
    settings = TrackSettings(
        device=device.value, filters=(0.0,), fields=False, search=False, gain="none", trend="none",
        view_corrections="never", iterations=4,
    )  # fmt: skip
    motions = track(grains(), scan(), settings=settings)
    return {
        "translations": motions.translations,
        "rotations": motions.rotations,
        "covariances": motions.covariances,
        "statuses": np.array([str(s) for s in motions.statuses]),
    }


def volume_and_images(beam: str) -> tuple[np.ndarray, np.ndarray]:
    """Random volume and images for `volume`."""
    rng = np.random.default_rng(7)
    return rng.random((7, 9, 8)), rng.normal(size=(5, *small_panel(beam).shape))


def volume(device: Device, projector: str = "trilinear", beam: str = "cone") -> dict:
    """Line integrals of a volume, and the volume plus the back-projection of images, in double precision."""
    array, images = volume_and_images(beam)
    grid, views = Volume(array, VOXEL, (0.03, 0.0, -0.02)), small_panel(beam)
    if device == Device.CPU:
        back = back_project(images, views, grid, projector=projector)
        return {"forward": project(grid, views, projector=projector), "adjoint": array + back.array}
    from grainmotion.projection.volume_operator_cuda import CudaVolumeOperator

    operator = CudaVolumeOperator(views, grid, projector)
    on_device = operator.padded(array)
    forward = operator.forward(on_device)
    operator.add_adjoint(images, on_device)
    return {"forward": forward, "adjoint": operator.unpadded(on_device)}


def small_panel(beam: str) -> Geometry:
    """Five views with 7 × 9 pixels; with a parallel beam, one of them is nearly along z."""
    angles = np.linspace(0, 150, 5)
    if beam == "cone":
        return Geometry.cone(angles, (7, 9), 4 * VOXEL, source_to_axis=20, source_to_detector=80)
    upright = Geometry.parallel(angles, (7, 9), VOXEL)
    vectors = upright.vectors.copy()
    vectors[3] = [0.1, 0.05, 1, 0, 0, 0, VOXEL, 0, 0, 0, VOXEL, 0]
    return dataclasses.replace(upright, vectors=vectors)


def reconstructed(device: Device, method: str) -> dict:
    """Reconstruction from views with masked pixels, by two sweeps or by a few subsets after a coarse start."""
    truth = Volume(np.random.default_rng(9).random((4, 5, 5)).astype(np.float32), VOXEL)
    views = Geometry.cone([0, 40, 95], (5, 6), 4 * VOXEL, source_to_axis=20, source_to_detector=80)
    valid = np.random.default_rng(1).random((3, 5, 6)) > 0.1
    measured = Scan(project(truth, views), views, valid=valid)
    settings = ReconstructSettings(method="sart", sweeps=2, tolerance=0.0, device=device.value)
    if method == "accelerated":
        settings = ReconstructSettings(method="accelerated", device=device.value)
    few = {"PHASES": ((3, 1, 1.5, 0.7), (1, 2, 1.0, 0.5)), "MIN_SUBSET_VIEWS": 2}
    with patch.multiple(ordered_subsets, **few), patch.object(coarse_start, "MIN_EXTENT", 4):
        result = reconstruct(measured, Volume.zeros(truth.shape, VOXEL), settings)
    return {"volume": result.volume.array, "residuals": np.array(result.residuals)}


TASKS = {
    "single again": lambda device: patches(device, np.float32, "trilinear"),
    "volume": volume,
    "exact volume": lambda device: volume(device, "exact"),
    "parallel volume": lambda device: volume(device, beam="parallel"),
    "sart": lambda device: reconstructed(device, "sart"),
    "accelerated": lambda device: reconstructed(device, "accelerated"),
    "single": lambda device: patches(device, np.float32, "trilinear"),
    "double": lambda device: patches(device, np.float64, "trilinear"),
    "exact": lambda device: patches(device, np.float64, "exact"),
    "linearized": linearized,
    "differences": lambda device: linearized(device, derivatives="differences"),
    "tracked": tracked,
}


def run_task(name: str, device: Device = Device.CPU) -> dict:
    """Result of a task: arrays by name."""
    return TASKS[name](device)


if __name__ == "__main__":
    import os
    import time

    if os.environ.get("NUMBA_ENABLE_CUDASIM") == "1":
        from gpu.simulated_blocks import mend_simulator

        mend_simulator()
    results = {}
    for task in sys.argv[2:]:
        t = time.time()
        results[task] = run_task(task, Device.CUDA)
        print(task, time.time() - t, file=sys.stderr)
    Path(sys.argv[1]).write_bytes(pickle.dumps(results))
