"""Moving grains to radiographs, and the derivatives of these by the grains' motions.

Each ray is carried back into each grain's own voxels and integrated there; voxels are never rotated or resampled
(the Lagrangian form of D-DPC: Khalili et al. 2017, §3).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from grainmotion._arguments import checked_arguments
from grainmotion._typing import Float, Image, Projector
from grainmotion.backends.base import BackendArray, PatchBackend
from grainmotion.backends.cpu import CPU
from grainmotion.errors import InputError
from grainmotion.kernels.layout import GrainTable, PatchTable, ViewTable
from grainmotion.model.geometry import Geometry
from grainmotion.model.grains import GrainSet
from grainmotion.model.motions import Motions
from grainmotion.model.pose import Pose
from grainmotion.projection.bodies import packed_body
from grainmotion.projection.displaced_fluid import Submersion
from grainmotion.projection.footprints import Patches, footprint_patches
from grainmotion.projection.grain_arrays import OUT_OF_PLANE, GrainArrays, planar
from grainmotion.projection.jacobian import PatchJacobian
from grainmotion.projection.volumes import project
from grainmotion.rotations import recenter, rotation_matrix


def project_patches(
    grains: GrainArrays, pose: Pose, geometry: Geometry, patches: Patches, projector: Projector
) -> Image:
    """Line integrals of every patch, flat (see `Patches.offsets`)."""
    return np.asarray(project_in_place(grains, pose, geometry, patches, projector))


def project_in_place(
    grains: GrainArrays, pose: Pose, geometry: Geometry, patches: Patches, projector: Projector
) -> BackendArray:
    """As `project_patches`, in the memory of the grains' backend."""
    return grains.backend.project(*_tables(grains, pose, geometry, patches), projector == "exact")


def differentiate_patches(
    grains: GrainArrays, pose: Pose, geometry: Geometry, patches: Patches, projector: Projector
) -> tuple[Image, Image]:
    """Line integrals of every patch, and their derivatives ``(6, pixels)`` by u (1/mm) and δ (1/rad).

    The derivatives are exact for the projector chosen; those by motions out of a planar sample's plane are zero.
    """
    values, jacobian = differentiate_in_place(grains, pose, geometry, patches, projector)
    return np.asarray(values), np.asarray(jacobian.derivatives)


def differentiate_in_place(
    grains: GrainArrays, pose: Pose, geometry: Geometry, patches: Patches, projector: Projector
) -> tuple[BackendArray, PatchJacobian]:
    """As `differentiate_patches`, in the memory of the Jacobian's backend."""
    tables = _tables(grains, pose, geometry, patches)
    values, derivatives = grains.backend.project_with_derivatives(*tables, projector == "exact")
    if not planar(grains, geometry):
        return values, PatchJacobian(derivatives, patches, grains.backend)
    on_host = np.array(derivatives)  # a slice has few pixels
    on_host[list(OUT_OF_PLANE)] = 0
    return np.asarray(values), PatchJacobian(on_host, patches)


def difference_patches(
    grains: GrainArrays, pose: Pose, geometry: Geometry, patches: Patches, projector: Projector
) -> tuple[Image, PatchJacobian]:
    """As `differentiate_in_place`, by forward differences on the host: the paper's seven projections a grain.

    Steps are a hundredth of a voxel, and the rotation that moves a grain's surface as much.
    """
    values = project_patches(grains, pose, geometry, patches, projector)
    derivatives = np.zeros((6, len(values)), grains.precision)
    shift = 0.01 * grains.voxel_size
    angle = shift / float(grains.radii.max())
    steps = list(enumerate([shift] * 3 + [angle] * 3))
    if planar(grains, geometry):
        steps = [s for s in steps if s[0] not in OUT_OF_PLANE]
    for k, step in steps:
        increment = step * np.eye(6)[k]
        moved = Pose(pose.translations + increment[:3], rotation_matrix(increment[3:]) @ pose.matrices)
        derivatives[k] = (project_patches(grains, moved, geometry, patches, projector) - values) / step
    return values, PatchJacobian(derivatives, patches)


def assemble(values: BackendArray, patches: Patches, geometry: Geometry, backend: PatchBackend = CPU) -> Image:
    """Radiographs ``(views, rows, columns)``: the sum of all patches, in their precision, on the host."""
    return backend.add_patches(values, patches.table, (len(geometry), *geometry.shape))


def body_image(body: GrainArrays, translation: Float, matrix: Float, geometry: Geometry, projector: Projector) -> Image:
    """Line integrals ``(views, rows, columns)`` of a packed body, moved by u (mm) and Ω about its centre."""
    pose = Pose(np.asarray(translation)[None], np.asarray(matrix)[None])
    patches = footprint_patches(body, pose, geometry)
    return assemble(project_patches(body, pose, geometry, patches, projector), patches, geometry)


def differentiated_body(
    body: GrainArrays, translation: Float, matrix: Float, geometry: Geometry, projector: Projector
) -> tuple[Image, list[Image]]:
    """As `body_image`, with the six derivatives by the body's (u, δ)."""
    pose = Pose(np.asarray(translation)[None], np.asarray(matrix)[None])
    patches = footprint_patches(body, pose, geometry)
    values, derivatives = differentiate_patches(body, pose, geometry, patches, projector)
    return assemble(values, patches, geometry), [assemble(d, patches, geometry) for d in derivatives]


@checked_arguments
def simulate_radiographs(
    grains: GrainSet, motions: Motions, geometry: Geometry, *, projector: Projector = "trilinear"
) -> Image:
    """Line integrals of the moved grains, of bodies and of a liquid.

    A liquid is as ``motions.fit.fluid`` says, else as in the reference.  Grains whose motion is unknown (NaN) are left
    out.

    Parameters
    ----------
    grains : GrainSet
        The grains of the reference state, in their scene.
    motions : Motions
        One motion a grain, in the grains' order; those of the bodies are in its ``fit``, which are known by name, and
        bodies without one stay where they are.
    geometry : Geometry
        Views to project to, in the sample frame.
    projector : {"trilinear", "exact"}
        The smooth image, sampled once a voxel, or the exact path through box-shaped voxels (Siddon).

    Returns
    -------
    (views, rows, columns) array
        Line integrals, dimensionless, in the grains' precision; gain and offset of `Motions.fit` are not applied.

    Raises
    ------
    InputError
        If the motions are not those of these grains, label by label.

    Examples
    --------
    >>> images = gm.simulate_radiographs(grains, motions, state.geometry)
    >>> images.shape
    (4, 96, 72)
    """
    if not np.array_equal(motions.labels, grains.labels):
        raise InputError("motions", "their labels are not the grains'", "give one motion a grain, in the grains' order")
    known = np.all(np.isfinite(np.hstack([motions.translations, motions.rotations])), axis=1)
    out = np.zeros((len(geometry), *geometry.shape), grains.precision)
    scene, fluid = grains.scene, motions.fit.fluid
    if scene.fluid is not None and fluid is not None:
        scene = replace(scene, fluid=scene.fluid.found(fluid))
    if known.any():
        kept = grains.without(np.nonzero(~known)[0])
        gradients = motions.gradients[known]
        shifts = recenter(gradients, motions.translations[known], motions.centers[known], kept.centers)
        pose = Pose(shifts, motions.matrices[known])
        if scene.fluid is not None and fluid is not None:
            kept = Submersion(kept).in_state(fluid, pose.moved(shifts, gradients))
        packed = GrainArrays.of(kept, fine=projector == "trilinear")
        if motions.strains is not None:
            packed = packed.stretched(motions.stretches[known])
        patches = footprint_patches(packed, pose, geometry)
        out = assemble(project_patches(packed, pose, geometry, patches, projector), patches, geometry)
    moved = {body.name: body for body in motions.fit.bodies}
    for body in scene.bodies:
        motion, packed = moved.get(body.name), packed_body(body)
        u, matrix = (np.zeros(3), np.eye(3)) if motion is None else (motion.translation, motion.matrix)
        out += body_image(packed, u, matrix, geometry, projector)
    if scene.fluid is not None:
        out += project(scene.fluid.volume, geometry, projector=projector)
    return out


def _tables(
    grains: GrainArrays, pose: Pose, geometry: Geometry, patches: Patches
) -> tuple[GrainTable, ViewTable, PatchTable]:
    """What a backend projects."""
    views = ViewTable(geometry.vectors, geometry.beam == "cone", np.array(geometry.shape))
    return grains.table(pose), views, patches.table
