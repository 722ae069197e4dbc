"""Projection: volumes and moving grains to radiographs, with adjoint and derivatives.

The Lagrangian way of D-DPC (Khalili et al. 2017, §3): a ray is pulled back into each grain's own voxels
and integrated there; voxels are never rotated or resampled.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from grainmotion import motion
from grainmotion.errors import InputError
from grainmotion.geometry import Geometry
from grainmotion.grains import GrainSet
from grainmotion.kernels import grains as kernel
from grainmotion.motions import Motions
from grainmotion.operators import Projector, VolumeOperator
from grainmotion.packed import OUT_OF_PLANE, Image, PackedGrains, Pose, planar
from grainmotion.volume import Volume

Float = NDArray[np.float64]


# ---------------------------------------------------------------------- whole volumes
def project(volume: Volume, geometry: Geometry, projector: Projector = "trilinear") -> Image:
    """Line integrals of a volume.

    Parameters
    ----------
    volume : Volume
        Attenuation, 1/mm.
    geometry : Geometry
        Views to project to.
    projector : {"trilinear", "exact"}
        See `Projector`.

    Returns
    -------
    (views, rows, columns) array
        Line integrals, dimensionless, in the precision of the volume.
    """
    operator = VolumeOperator(geometry, volume, projector)
    return operator.forward(operator.laid(volume.array))


def back_project(images: Image, geometry: Geometry, grid: Volume, projector: Projector = "trilinear") -> Volume:
    """The exact adjoint of `project`: ⟨A x, y⟩ = ⟨x, Aᵀ y⟩; place and precision are those of ``grid``."""
    operator = VolumeOperator(geometry, grid, projector)
    image = operator.empty()
    operator.add_adjoint(images, image)
    return Volume(operator.unlaid(image), grid.voxel_size, grid.center)


# ---------------------------------------------------------------------- moving grains
@dataclass(frozen=True, eq=False)
class Patches:
    """The pixels that grains shade, one patch a (grain, view); see `kernels.grains` for the columns.

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


def shadows(grains: PackedGrains, pose: Pose, geometry: Geometry, margin: int = 0) -> Patches:
    """Patches that the grains shade in each view, widened by ``margin`` pixels, cut at the panel's edges."""
    rows, columns = geometry.shape
    moved = np.einsum("nij,nkj->nki", pose.matrices, grains.hulls)
    moved += (grains.centers + pose.translations)[:, None]
    n, k = moved.shape[:2]
    spots = geometry.project_points(moved.reshape(-1, 3)).reshape(len(geometry), n, k, 2)
    # A voxel's image reaches up to √3 voxels beyond its centre; rounding to whole pixels gives the rest.
    pixels = geometry.pixels_at(grains.centers)
    slack = np.ceil(0.4 + 1.5 * grains.voxel_size / pixels).astype(np.int64)[:, None]
    with np.errstate(invalid="ignore"):
        low = np.floor(np.nan_to_num(spots.min(axis=2), nan=-1e9)).astype(np.int64) - slack
        high = np.ceil(np.nan_to_num(spots.max(axis=2), nan=-1e9)).astype(np.int64) + slack + 1
    if planar(grains, geometry):
        low[..., 0], high[..., 0] = 0, 1
    edge = np.array([rows, columns])
    inner_low, inner_high = np.clip(low, 0, edge), np.clip(high, 0, edge)
    area = np.prod(np.maximum(high - low, 1), axis=2)
    seen = np.prod(np.maximum(inner_high - inner_low, 0), axis=2) / area
    outer_low, outer_high = np.clip(low - margin, 0, edge), np.clip(high + margin, 0, edge)
    grain, view = np.nonzero(np.prod(np.maximum(inner_high - inner_low, 0), axis=2).T)
    a, b = outer_low[view, grain], outer_high[view, grain]
    boxes = np.column_stack([grain, view, a[:, 0], b[:, 0], a[:, 1], b[:, 1]]).astype(np.int64)
    core_low, core_high = inner_low[view, grain], inner_high[view, grain]
    heights = core_high[:, 0] - core_low[:, 0]
    patch = np.repeat(np.arange(len(boxes)), heights)
    row = np.arange(len(patch)) - np.repeat(np.cumsum(heights) - heights, heights) + core_low[patch, 0]
    jobs = np.column_stack([patch, row, core_low[patch, 1], core_high[patch, 1]]).astype(np.int64)
    return Patches(boxes, jobs, seen.T)


def project_patches(
    grains: PackedGrains, pose: Pose, geometry: Geometry, patches: Patches, projector: Projector
) -> Image:
    """Line integrals of every patch, flat (see `Patches.offsets`)."""
    values = np.zeros(int(patches.offsets[-1]), grains.precision)
    _walk(kernel.project, grains, pose, geometry, patches, projector, values)
    return values


def differentiate_patches(
    grains: PackedGrains, pose: Pose, geometry: Geometry, patches: Patches, projector: Projector
) -> tuple[Image, Image]:
    """Line integrals of every patch, and their derivatives ``(6, pixels)`` by u (1/mm) and δ (1/rad).

    Derivatives by what a planar sample cannot do are zero.
    """
    total = int(patches.offsets[-1])
    values, derivatives = np.zeros(total, grains.precision), np.zeros((6, total), grains.precision)
    _walk(kernel.project_with_derivatives, grains, pose, geometry, patches, projector, values, derivatives)
    if planar(grains, geometry):
        derivatives[list(OUT_OF_PLANE)] = 0
    return values, derivatives


def difference_patches(
    grains: PackedGrains, pose: Pose, geometry: Geometry, patches: Patches, projector: Projector
) -> tuple[Image, Image]:
    """As `differentiate_patches`, by forward differences: the paper's seven projections a grain.

    Steps are a hundredth of a voxel, and the rotation that moves a grain's rim as much.
    """
    values = project_patches(grains, pose, geometry, patches, projector)
    derivatives = np.zeros((6, len(values)), grains.precision)
    shift = np.full(len(grains), 0.01 * grains.voxel_size)
    steps = [shift] * 3 + [shift / np.linalg.norm(grains.hulls, axis=2).max(axis=1)] * 3
    owners = np.repeat(patches.boxes[:, 0], np.diff(patches.offsets))
    for k in [k for k in range(6) if not (k in OUT_OF_PLANE and planar(grains, geometry))]:
        increment = steps[k][:, None] * np.eye(6)[k]
        moved = Pose(pose.translations + increment[:, :3], motion.exp(increment[:, 3:]) @ pose.matrices)
        change = project_patches(grains, moved, geometry, patches, projector) - values
        derivatives[k] = change / steps[k][owners]
    return values, derivatives


def assemble(values: Image, patches: Patches, geometry: Geometry) -> Image:
    """Radiographs ``(views, rows, columns)``: the sum of all patches, in their precision."""
    return added_up(values, patches, geometry).astype(values.dtype)


def added_up(values: Image, patches: Patches, geometry: Geometry) -> Float:
    """The same in double precision: sums of single numbers are exact there, and the same in any order."""
    out = np.zeros((len(geometry), *geometry.shape))
    kernel.add_patches(values, patches.boxes, patches.offsets, out)
    return out


def simulate_radiographs(
    grains: GrainSet, motions: Motions, geometry: Geometry, projector: Projector = "trilinear"
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
        packed = PackedGrains.of(kept, fine=projector == "trilinear")
        matrices = motions.matrices[known]
        shifts = motion.recenter(matrices, motions.translations[known], motions.centers[known], kept.centers)
        pose = Pose(shifts, matrices)
        patches = shadows(packed, pose, geometry)
        out = assemble(project_patches(packed, pose, geometry, patches, projector), patches, geometry)
    if grains.background is not None:
        out += project(grains.background, geometry, projector)
    return out


def _walk(
    function: Callable[..., None],
    grains: PackedGrains,
    pose: Pose,
    geometry: Geometry,
    patches: Patches,
    projector: Projector,
    *out: NDArray[np.floating],
) -> None:
    """Call a kernel of `kernels.grains` on nouns."""
    function(
        grains.images, grains.starts, grains.shapes, grains.corners, grains.extents, grains.voxel_size,
        grains.centers + pose.translations, np.ascontiguousarray(pose.matrices), geometry.vectors,
        geometry.beam == "cone", np.array(geometry.shape), patches.boxes, patches.offsets, patches.jobs,
        projector == "exact", *out,
    )  # fmt: skip
