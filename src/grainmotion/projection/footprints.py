"""Footprints: the pixels that moving grains reach in each view, one patch a (grain, view)."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from grainmotion._typing import Float
from grainmotion.kernels import footprints
from grainmotion.kernels.layout import PatchTable, patch_table
from grainmotion.model.geometry import Geometry
from grainmotion.model.pose import Pose
from grainmotion.projection.grain_arrays import GrainArrays, planar

HULL_SLACK = 0.013
"""How far a rounded grain may reach beyond the points of its hull, over its largest radius."""


@dataclass(frozen=True, eq=False)
class Patches:
    """The footprints of grains (see `kernels.layout.PatchTable`).

    ``boxes`` include a margin for filtering, ``jobs`` list the pixels of the footprints alone, ``seen (n, views)`` is
    the fraction of each grain's footprint on the detector, and ``panel`` the detector's (rows, columns).
    """

    boxes: NDArray[np.int64]
    jobs: NDArray[np.int64]
    seen: Float
    panel: tuple[int, int]

    @cached_property
    def table(self) -> PatchTable:
        """The patches, as kernels take them."""
        return patch_table(self.boxes, self.jobs, self.seen.shape[1])

    @property
    def offsets(self) -> NDArray[np.int64]:
        """Start of each patch in the flat arrays, with the total at the end."""
        return self.table.offsets

    @property
    def grain_offsets(self) -> NDArray[np.int64]:
        """Start of the patches of each grain, which follow each other, with the total at the end, ``(n + 1,)``."""
        return self.offsets[np.searchsorted(self.boxes[:, 0], np.arange(len(self.seen) + 1))]

    @property
    def stack_shape(self) -> tuple[int, int, int]:
        """Views, rows and columns of the radiographs."""
        return self.seen.shape[1], *self.panel


def footprint_patches(
    grains: GrainArrays, pose: Pose, geometry: Geometry, margin: int = 0, middle: Float | None = None
) -> Patches:
    """Footprints of the grains in each view, widened by ``margin`` pixels, cut at the detector's edges.

    The size of a pixel is taken at ``middle (3,)``, by default the middle of the grains.
    """
    directions = footprints.OUTLINE_DIRECTIONS
    found = np.empty((len(grains), len(geometry), len(directions), 2))
    inverses, origins = _frames(geometry)
    footprints.extents(
        grains.hulls, grains.centers + pose.translations, np.ascontiguousarray(pose.matrices), inverses, origins,
        geometry.beam == "cone", np.array(geometry.shape), directions, found,
    )  # fmt: skip
    # a voxel's image reaches up to √3 voxels beyond its centre, and a ball reaches beyond the points of its hull
    reach = np.linalg.norm(grains.hulls, axis=2).max(axis=1)
    middle = grains.centers.mean(axis=0) if middle is None else middle
    slack = 0.25 + (1.75 * grains.voxel_reach + HULL_SLACK * reach) / geometry.pixel_at(middle)
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
    return Patches(boxes, jobs[:count], inside / area, geometry.shape)


def _frames(geometry: Geometry) -> tuple[Float, Float]:
    """What carries a point to pixels of each view, see `kernels.footprints.extents`."""
    start = geometry.source if geometry.beam == "cone" else geometry.detector
    frames: Float = np.linalg.inv(np.stack([geometry.u, geometry.v, geometry.rays], axis=-1))
    return frames, start.copy()  # that of one view is contiguous, and read-only: another type to the kernel
