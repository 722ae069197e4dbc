"""The same small work on any device: run by the tests on the processor, and by a process of its own on the card.

``python tests/gpu/work.py OUT NAME...`` does the named tasks on the card (CUDA's simulator, where the environment
says so before numba is imported) and leaves what they return in OUT.
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
SPOTS = ((4.5, 5.0, 5.0), (10.0, 5.5, 6.0))  # x y z, voxels


def geometry(views: int = 3, beam: str = "cone") -> Geometry:
    """A panel on which the sample's shadow just fits; a pixel at the axis is a voxel."""
    angles = np.linspace(0, 150, views)
    if beam == "parallel":
        return Geometry.parallel(angles, (16, 19), VOXEL)
    return Geometry.cone(angles, (16, 19), 4 * VOXEL, source_to_axis=20, source_to_detector=80)


def grains(precision: type = np.float32) -> GrainSet:
    """Two lumps of about 6 voxels, textured."""
    z, y, x = np.mgrid[: SHAPE[0], : SHAPE[1], : SHAPE[2]].astype(float)
    both = []
    for k, (x0, y0, z0) in enumerate(SPOTS):
        distance = np.sqrt((x - x0) ** 2 + ((y - y0) * (1.2 + 0.2 * k)) ** 2 + ((z - z0) / 1.1) ** 2)
        both.append(np.clip(3.3 - distance, 0, 1) * (1 + 0.3 * np.sin(1.3 * x + k) * np.cos(y - 0.7 * z)))
    labels = np.where(both[0] > both[1], 1, np.where(both[1] > 0, 2, 0))
    return grains_from_labels(Volume((both[0] + both[1]).astype(precision), VOXEL), labels, reach=0, finer=1)


def pose(count: int) -> Pose:
    """Every grain moved and turned its own way."""
    rng = np.random.default_rng(3)
    turns = rotation_matrix(rng.uniform(-0.4, 0.4, (count, 3)))
    return Pose(VOXEL * rng.uniform(-0.8, 0.8, (count, 3)), turns)


def patches(device: Device, precision: type, projector: str) -> dict:
    """Values, derivatives, filtered patches, radiographs, gradients and blocks of moved grains."""
    packed = GrainArrays.of(grains(precision)).on(backend_of(device))
    views, at, kernel = geometry(), pose(2), gaussian(1.0).astype(precision)
    seen = footprint_patches(packed, at, views, margin=len(kernel) - 1)
    rng = np.random.default_rng(5)
    images = rng.normal(size=(len(views), *views.shape)).astype(precision)
    valid = (rng.random(images.shape) > 0.1).astype(precision)
    values, jacobian = differentiate_in_place(packed, at, views, seen, projector)
    plain = np.array(jacobian.derivatives)
    radiographs = assemble(values, seen, views, jacobian.backend)
    again = jacobian.copy()
    jacobian.filter(valid, kernel)
    again.filter(valid, np.ones(1, precision))
    (dots,) = jacobian.vjp([images])
    return {
        "values alone": project_patches(packed, at, views, seen, projector),
        "values": np.array(values),
        "derivatives": plain,
        "filtered": np.array(jacobian.derivatives),
        "masked": np.array(again.derivatives),
        "radiographs": radiographs,
        "gradients": dots,
        "spread": jacobian.images(rng.normal(size=(1, 2, 6)))[0],
        "product": PatchNormalMatrix(jacobian) @ rng.normal(size=12),
        "blocks": normal_matrix(jacobian).toarray(),
    }


def linearized(device: Device, **options: object) -> dict:
    """The normal equations of a state."""
    packed = GrainArrays.of(grains()).on(backend_of(device))
    target = Target(scan(), np.zeros(scan().line_integrals.shape, np.float32), "trilinear", 0.8,
                    ResponseModel("global", "constant", 1), backend=backend_of(device), **options)  # fmt: skip
    found = StateProblem(packed, target).linearize(pose(2))
    return {
        "cost": np.array(found.cost),
        "gradient": found.gradient,
        "hessian": found.hessian.toarray(),
        "border": found.border,
        "corner": found.corner,
    }


def truth() -> Motions:
    """Where the state's grains are."""
    still, at = grains(), pose(2)
    motions = Motions.identity(still.labels, still.centers)
    return dataclasses.replace(
        motions, translations=0.5 * at.translations, rotations=0.25 * rotation_vector(at.matrices)
    )


def scan(views: int = 3) -> Scan:
    """Radiographs of that state."""
    return Scan(simulate_radiographs(grains(), truth(), geometry(views)), geometry(views))


def tracked(device: Device) -> dict:
    """A whole state."""
    settings = TrackSettings(
        device=device.value, filters=(0.0,), fields=False, search=False, gain="none", trend="none",
        view_corrections="never", iterations=4,
    )  # fmt: skip
    found = track(grains(), scan(), settings=settings)
    return {
        "translations": found.translations,
        "rotations": found.rotations,
        "covariances": found.covariances,
        "statuses": np.array([str(s) for s in found.statuses]),
    }


def volume_and_images(beam: str) -> tuple[np.ndarray, np.ndarray]:
    """Voxels and pixels of `volume`."""
    rng = np.random.default_rng(7)
    return rng.random((7, 9, 8)), rng.normal(size=(5, *small_panel(beam).shape))


def volume(device: Device, projector: str = "trilinear", beam: str = "cone") -> dict:
    """Line integrals of a whole volume and, added to it, the adjoint of images; in double precision."""
    array, images = volume_and_images(beam)
    grid, views = Volume(array, VOXEL, (0.03, 0.0, -0.02)), small_panel(beam)
    if device == Device.CPU:
        back = back_project(images, views, grid, projector=projector)
        return {"forward": project(grid, views, projector=projector), "adjoint": array + back.array}
    from grainmotion.projection.volume_operator_cuda import CudaVolumeOperator

    operator = CudaVolumeOperator(views, grid, projector)
    held = operator.padded(array)
    forward = operator.forward(held)
    operator.add_adjoint(images, held)
    return {"forward": forward, "adjoint": operator.unpadded(held)}


def small_panel(beam: str) -> Geometry:
    """Five views by a panel of 7 × 9 pixels, of which one is nearly along z for a parallel beam."""
    angles = np.linspace(0, 150, 5)
    if beam == "cone":
        return Geometry.cone(angles, (7, 9), 4 * VOXEL, source_to_axis=20, source_to_detector=80)
    upright = Geometry.parallel(angles, (7, 9), VOXEL)
    vectors = upright.vectors.copy()
    vectors[3] = [0.1, 0.05, 1, 0, 0, 0, VOXEL, 0, 0, 0, VOXEL, 0]
    return dataclasses.replace(upright, vectors=vectors)


def reconstructed(device: Device, method: str) -> dict:
    """A volume reconstructed from views with dead pixels, by two sweeps or by few subsets and a coarse start."""
    truth = Volume(np.random.default_rng(9).random((4, 5, 5)).astype(np.float32), VOXEL)
    views = Geometry.cone([0, 40, 95], (5, 6), 4 * VOXEL, source_to_axis=20, source_to_detector=80)
    valid = np.random.default_rng(1).random((3, 5, 6)) > 0.1
    seen = Scan(project(truth, views), views, valid=valid)
    settings = ReconstructSettings(method="sart", sweeps=2, tolerance=0.0, device=device.value)
    if method == "accelerated":
        settings = ReconstructSettings(method="accelerated", device=device.value)
    few = {"PHASES": ((3, 1, 1.5, 0.7), (1, 2, 1.0, 0.5)), "MIN_SUBSET_VIEWS": 2}
    with patch.multiple(ordered_subsets, **few), patch.object(coarse_start, "MIN_EXTENT", 4):
        found = reconstruct(seen, Volume.zeros(truth.shape, VOXEL), settings)
    return {"volume": found.volume.array, "residuals": np.array(found.residuals)}


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


def done(name: str, device: Device = Device.CPU) -> dict:
    """What a task returns."""
    return TASKS[name](device)


if __name__ == "__main__":
    import time

    results = {}
    for task in sys.argv[2:]:
        t = time.time()
        results[task] = done(task, Device.CUDA)
        print(task, time.time() - t, file=sys.stderr)
    Path(sys.argv[1]).write_bytes(pickle.dumps(results))
