"""Labels that grow into the voxels around them, the highest first.

A voxel belongs to its highest neighbour if that is higher, and a local maximum without a label, with all that belongs
to it, to the label at the other end of its highest pass.  That is what a watershed by flooding gives, but for few
voxels on the slopes of such a maximum, which some floods reach before it.  Nothing of it depends on an order of voxels
but where values are equal; there the first in the array is the higher one.
"""

from __future__ import annotations

import threading

import numpy as np
from numpy.typing import NDArray

from grainmotion.kernels import highest_passes
from grainmotion.kernels.steepest_ascent import climb_to_labels, find_tops
from grainmotion.segmentation.blocks import Work, slabs_of
from grainmotion.segmentation.label_measures import renumber

Ints = NDArray[np.int32]


def grow_labels(labels: Ints, heights: NDArray, count: int, work: Work) -> None:
    """Let labels grow, in place.

    Parameters
    ----------
    labels : (nz, ny, nx) int32 array
        1 … ``count``, -1 where a label is wanted, 0 elsewhere.  What no label can reach becomes 0.
    heights : (nz, ny, nx) array
        Highest first.
    count : int
        The highest label.
    work : Work
        Threads.
    """
    slabs = slabs_of(labels.shape)
    tops = np.concatenate(work.each(slabs, lambda slab: find_tops(heights, labels, *slab)))
    labels.reshape(-1)[tops] = np.arange(count + 1, count + len(tops) + 1, dtype=np.int32)
    joined = np.arange(count + len(tops) + 1, dtype=np.int32)
    del tops
    work.each(slabs, lambda slab: climb_to_labels(heights, labels, *slab))
    while len(joined) > count + 1 and _joined_further(labels, heights, joined, count, work):
        pass
    joined[joined > count] = 0
    renumber(labels, joined, work)


def _joined_further(labels: Ints, heights: NDArray, joined: Ints, count: int, work: Work) -> bool:
    """Join the regions without a label along their highest passes, once; whether there was one to join."""
    shape, lock = (len(joined),), threading.Lock()
    passes = np.empty(shape, heights.dtype), np.empty(shape, heights.dtype), np.full(shape, -1, np.int64)

    def find(slab: tuple[int, int]) -> None:
        planes = labels[slab[0] : slab[1] + 1]  # faces with the next plane, too
        low, high = highest_passes.wanting_range(planes.reshape(-1), joined, count)
        if high < low:
            return
        size = high - low + 1
        found = np.empty(size, heights.dtype), np.empty(size, heights.dtype), np.full(size, -1, np.int64)
        highest_passes.find_passes(labels, heights, joined, count, slab, low, *found)
        with lock:
            highest_passes.raise_passes(low, found, *passes)

    work.each(slabs_of(labels.shape), find)
    return bool(highest_passes.join_along(labels, joined, count, passes[2]))
