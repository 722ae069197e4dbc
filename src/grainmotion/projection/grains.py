"""Projection: volumes and moving grains to radiographs, with adjoint and derivatives.

The Lagrangian way of D-DPC (Khalili et al. 2017, §3): a ray is pulled back into each grain's own voxels
and integrated there; voxels are never rotated or resampled.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grainmotion._typing import Float, Image, Projector
from grainmotion.backends.device import CARD, place, zeros_beside
from grainmotion.errors import InputError
from grainmotion.kernels import footprints
from grainmotion.model.geometry import Geometry
from grainmotion.model.grains import GrainSet
from grainmotion.model.motions import Motions
from grainmotion.model.pose import Pose
from grainmotion.projection.grain_arrays import OUT_OF_PLANE, GrainArrays, planar
from grainmotion.projection.volumes import project
from grainmotion.rotations import recenter, rotation_matrix

RIM = 0.013
"""Of a grain's reach: how far a rounded grain may reach beyond its hull's points."""


# ---------------------------------------------------------------------- moving grains
@dataclass(frozen=True, eq=False)
class Patches:
    """The pixels that grains shade, one patch a (grain, view); see `kernels.grain_projection` for the columns.

    ``boxes`` include a margin for filtering, ``jobs`` list the shaded pixels alone, and ``seen (n, views)``
    is the fraction of each grain's shadow that falls on the panel.
    """

    boxes: NDArray[np.int64]
    jobs: NDArray[np.int64]
    seen: Float

    @cached_property
    def offsets(self) -> NDArray[np.int64]:
        """Start of each patch in the flat buffers, with the total at the end."""
        b = self.boxes
        sizes = (b[:, 3] - b[:, 2]) * (b[:, 5] - b[:, 4])
        return np.concatenate([[0], np.cumsum(sizes)]).astype(np.int64)

    @cached_property
    def by_view(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Patches in the order of their views, and where each view's begin, with the end of the last."""
        views = self.boxes[:, 1]
        order = np.argsort(views, kind="stable")
        return order, np.searchsorted(views[order], np.arange(self.seen.shape[1] + 1))


def shadows(
    grains: GrainArrays, pose: Pose, geometry: Geometry, margin: int = 0, middle: Float | None = None
) -> Patches:
    """Patches that the grains shade in each view, widened by ``margin`` pixels, cut at the panel's edges.

    The size of a pixel is taken at ``middle (3,)``, by default the middle of the grains.
    """
    directions = footprints.DIRECTIONS
    found = np.empty((len(grains), len(geometry), len(directions), 2))
    inverses, origins = _frames(geometry)
    footprints.extents(
        grains.hulls, grains.centers + pose.translations, np.ascontiguousarray(pose.matrices), inverses, origins,
        geometry.beam == "cone", np.array(geometry.shape), directions, found,
    )  # fmt: skip
    # a voxel's image reaches up to √3 voxels beyond its centre, and the hull's points leave a ball's rim between them
    reach = np.linalg.norm(grains.hulls, axis=2).max(axis=1)
    middle = grains.centers.mean(axis=0) if middle is None else middle
    slack = 0.25 + (1.75 * grains.voxel_size + RIM * reach) / geometry.pixel_at(middle)
    ends = np.nan_to_num(found[:, :, [0, len(directions) // 2]], nan=-1e9)  # along rows, along columns
    low = np.ceil(ends[..., 0] - slack[:, None, None]).astype(np.int64)
    high = np.floor(ends[..., 1] + slack[:, None, None]).astype(np.int64) + 1
    if planar(grains, geometry):
        low[..., 0], high[..., 0] = 0, 1
    edge = np.array(geometry.shape)
    inner_low, inner_high = np.clip(low, 0, edge), np.clip(high, 0, edge)
    area = np.prod(np.maximum(high - low, 1), axis=2)
    inside = np.prod(np.maximum(inner_high - inner_low, 0), axis=2)
    grain, view = np.nonzero(inside)
    core_low, core_high = inner_low[grain, view], inner_high[grain, view]
    a = np.clip(low[grain, view] - margin, 0, edge)
    b = np.clip(high[grain, view] + margin, 0, edge)
    boxes = np.column_stack([grain, view, a[:, 0], b[:, 0], a[:, 1], b[:, 1]]).astype(np.int64)
    cores = np.column_stack([core_low[:, 0], core_high[:, 0], core_low[:, 1], core_high[:, 1]])
    jobs = np.empty((int((cores[:, 1] - cores[:, 0]).sum()), 4), np.int64)
    count = footprints.lines(found[grain, view], cores, directions, slack[grain], jobs)
    return Patches(boxes, jobs[:count], inside / area)


def _frames(geometry: Geometry) -> tuple[Float, Float]:
    """What carries a point to pixels of each view, see `kernels.footprints.extents`."""
    start = geometry.source if geometry.beam == "cone" else geometry.detector
    frames: Float = np.linalg.inv(np.stack([geometry.u, geometry.v, geometry.rays], axis=-1))
    return frames, np.ascontiguousarray(start)


def project_patches(
    grains: GrainArrays, pose: Pose, geometry: Geometry, patches: Patches, projector: Projector
) -> Image:
    """Line integrals of every patch, flat (see `Patches.offsets`)."""
    return np.asarray(project_in_place(grains, pose, geometry, patches, projector))


def project_in_place(
    grains: GrainArrays, pose: Pose, geometry: Geometry, patches: Patches, projector: Projector
) -> Any:
    """As `project_patches`, but the values stay on the card if the grains are there."""
    values = zeros_beside(grains.walked, int(patches.offsets[-1]))
    _walk("project", grains, pose, geometry, patches, projector, values)
    return values


def differentiate_patches(
    grains: GrainArrays, pose: Pose, geometry: Geometry, patches: Patches, projector: Projector
) -> tuple[Image, Image]:
    """Line integrals of every patch, and their derivatives ``(6, pixels)`` by u (1/mm) and δ (1/rad).

    The derivatives are exact for the projector chosen; those by motions out of a planar sample's plane are zero.
    """
    values, derivatives = differentiate_in_place(grains, pose, geometry, patches, projector)
    return np.asarray(values), np.asarray(derivatives)


def differentiate_in_place(
    grains: GrainArrays, pose: Pose, geometry: Geometry, patches: Patches, projector: Projector
) -> tuple[Any, Any]:
    """As `differentiate_patches`, but both stay on the card if the grains are there."""
    total = int(patches.offsets[-1])
    values, derivatives = zeros_beside(grains.walked, total), zeros_beside(grains.walked, (6, total))
    _walk("project_with_derivatives", grains, pose, geometry, patches, projector, values, derivatives)
    if planar(grains, geometry):
        values, derivatives = np.asarray(values), np.asarray(derivatives)  # few pixels: the rest is the host's
        derivatives[list(OUT_OF_PLANE)] = 0
    return values, derivatives


def difference_patches(
    grains: GrainArrays, pose: Pose, geometry: Geometry, patches: Patches, projector: Projector
) -> tuple[Image, Image]:
    """As `differentiate_patches`, by forward differences: the paper's seven projections a grain.

    Steps are a hundredth of a voxel, and the rotation that moves a grain's rim as much.
    """
    values = project_patches(grains, pose, geometry, patches, projector)
    derivatives = np.zeros((6, len(values)), grains.precision)
    shift = 0.01 * grains.voxel_size
    turn = shift / float(grains.radii.max())
    steps = list(enumerate([shift] * 3 + [turn] * 3))
    if planar(grains, geometry):
        steps = [s for s in steps if s[0] not in OUT_OF_PLANE]
    for k, step in steps:
        increment = step * np.eye(6)[k]
        moved = Pose(pose.translations + increment[:3], rotation_matrix(increment[3:]) @ pose.matrices)
        derivatives[k] = (project_patches(grains, moved, geometry, patches, projector) - values) / step
    return values, derivatives


def assemble(values: Any, patches: Patches, geometry: Geometry) -> Image:
    """Radiographs ``(views, rows, columns)``: the sum of all patches, in their precision.

    They are added up in double, where sums of single numbers are the same in any order, by whomever.
    """
    out = np.zeros((len(geometry), *geometry.shape), values.dtype if place(values) == CARD else float)
    place(values).kernels("grain_projection").add_patches(values, patches.boxes, patches.offsets, out)
    return out.astype(values.dtype, copy=False)


def simulate_radiographs(
    grains: GrainSet, motions: Motions, geometry: Geometry, *, projector: Projector = "trilinear"
) -> Image:
    """Line integrals of the moved grains and the background.

    Grains whose motion is unknown (NaN) are left out.

    Returns
    -------
    (views, rows, columns) array
        Line integrals, dimensionless, in the grains' precision; gain and offset of `Motions.fit` are not applied.

    Raises
    ------
    InputError
        If the motions are not those of these grains, label by label.
    """
    if not np.array_equal(motions.labels, grains.labels):
        raise InputError("motions", "their labels are not the grains'", "give one motion a grain, in the grains' order")
    known = np.all(np.isfinite(np.hstack([motions.translations, motions.rotations])), axis=1)
    out = np.zeros((len(geometry), *geometry.shape), grains.precision)
    if known.any():
        kept = GrainSet(tuple(g for g, k in zip(grains.grains, known, strict=True) if k))
        packed = GrainArrays.of(kept, fine=projector == "trilinear")
        matrices = motions.matrices[known]
        shifts = recenter(matrices, motions.translations[known], motions.centers[known], kept.centers)
        pose = Pose(shifts, matrices)
        patches = shadows(packed, pose, geometry)
        out = assemble(project_patches(packed, pose, geometry, patches, projector), patches, geometry)
    if grains.background is not None:
        out += project(grains.background, geometry, projector=projector)
    return out


def _walk(
    kernel: str,
    grains: GrainArrays,
    pose: Pose,
    geometry: Geometry,
    patches: Patches,
    projector: Projector,
    *out: Any,
) -> None:
    """Call a kernel of `kernels.grain_projection`, or its counterpart on the card, on nouns."""
    images = grains.walked
    getattr(place(images).kernels("grain_projection"), kernel)(
        images, grains.starts, grains.shapes, grains.corners, grains.extents, grains.voxel_size,
        grains.centers + pose.translations, np.ascontiguousarray(pose.matrices), geometry.vectors,
        geometry.beam == "cone", np.array(geometry.shape), patches.boxes, patches.offsets, patches.jobs,
        projector == "exact", *out,
    )  # fmt: skip
