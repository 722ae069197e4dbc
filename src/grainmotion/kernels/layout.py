"""How arrays that kernels trace are laid out in memory: tables of grains, views and patches.

A patch is the rectangle of pixels that one grain reaches in one view; the pixels of all patches lie one after the
other, in row order, in flat arrays.  `kernels.grain_projection` says what each table is used for.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

PADDING = 2  # empty voxels kept around each grain, so that interpolation never leaves its crop


class GrainTable(NamedTuple):
    """Grains at their poses.

    ``voxels`` are those of all grains, flat; grain g's begin at ``starts[g]``, in C order with ``shapes[g]`` (z, y, x),
    voxel [0, 0, 0] at ``corners[g]`` (x y z, mm) from its centre, and lie between the planes ``extents[g]``
    ``(2, directions)`` (see `grain_ray_tracing.between`).  ``positions (n, 3)`` are the moved centres, mm, and
    ``rotations (n, 3, 3)`` turn a grain's frame into the sample's.  ``stretches (n, 3, 3)`` deform the grains before
    they rotate (see `stretched_grain_projection`); None for rigid grains.
    """

    voxels: object
    starts: NDArray[np.int64]
    shapes: NDArray[np.int64]
    corners: NDArray[np.float64]
    extents: NDArray[np.floating]
    voxel_size: float
    positions: NDArray[np.float64]
    rotations: NDArray[np.float64]
    stretches: NDArray[np.float64] | None = None


class ViewTable(NamedTuple):
    """Views: ``vectors (views, 12)`` as of a `Geometry`, the kind of beam, and ``panel`` (rows, columns)."""

    vectors: NDArray[np.float64]
    cone: bool
    panel: NDArray[np.int64]


class PatchTable(NamedTuple):
    """Patches.

    A row of ``boxes (patches, 6)`` is grain, view, first row, end row, first column, end column; the patch's pixels
    begin at ``offsets[patch]``, and ``offsets`` ends with the total.  ``lines (k, 4)`` are the runs of pixels to trace,
    (patch, row, first column, end column).  ``order[view_starts[i]:view_starts[i + 1]]`` are the patches of view i.
    """

    boxes: NDArray[np.int64]
    offsets: NDArray[np.int64]
    lines: NDArray[np.int64]
    order: NDArray[np.int64]
    view_starts: NDArray[np.int64]


def patch_table(boxes: NDArray[np.int64], lines: NDArray[np.int64], views: int) -> PatchTable:
    """The table of patches ``boxes`` in so many views."""
    sizes = (boxes[:, 3] - boxes[:, 2]) * (boxes[:, 5] - boxes[:, 4])
    order = np.argsort(boxes[:, 1], kind="stable")
    view_starts = np.searchsorted(boxes[order, 1], np.arange(views + 1))
    return PatchTable(boxes, np.concatenate([[0], np.cumsum(sizes)]).astype(np.int64), lines, order, view_starts)
