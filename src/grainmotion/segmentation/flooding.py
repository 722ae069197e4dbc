"""Labels that grow into the voxels around them, the highest first.

A voxel belongs to its highest neighbour if that is higher, and a local maximum without a label, with all that belongs
to it, to the label at the other end of its highest pass.  That is what a watershed by flooding gives, but for few
voxels on the slopes of such a maximum, which some floods reach before it.  Nothing of it depends on an order of voxels
but where values are equal; there the first in the array is the higher one.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from grainmotion.kernels.steepest_ascent import climb_to_labels, find_tops, join_tops
from grainmotion.segmentation.blocks import Work, slabs_of
from grainmotion.segmentation.label_pairs import LabelPairs

Ints = NDArray[np.int32]


def flooded_regions(labels: Ints, heights: NDArray, count: int, work: Work) -> tuple[LabelPairs, Ints]:
    """Let labels grow, in place, and number the local maxima that they don't reach by rising paths.

    Parameters
    ----------
    labels : (nz, ny, nx) int32 array
        1 … ``count``, -1 where a label is wanted, 0 elsewhere.
    heights : (nz, ny, nx) array
        Highest first.
    count : int
        The highest label.
    work : Work
        Threads.

    Returns
    -------
    pairs : LabelPairs
        Of the regions, which include those of local maxima, from ``count + 1`` on.
    new : (regions + 1,) int32 array
        The label of each region, 0 if there is none to reach.
    """
    slabs = slabs_of(labels.shape)
    tops = np.concatenate(work.each(slabs, lambda slab: find_tops(heights, labels, *slab)))
    regions = count + len(tops)
    labels.reshape(-1)[tops] = np.arange(count + 1, regions + 1, dtype=np.int32)
    work.each(slabs, lambda slab: climb_to_labels(heights, labels, *slab))
    pairs = LabelPairs.of(labels, heights, regions, work)
    order = np.lexsort((-pairs.beside, -pairs.tops[:, 0]))  # of equal passes the one beside the highest voxel
    new = join_tops(pairs.pairs[:, 0].copy(), pairs.pairs[:, 1].copy(), order, count, regions)
    return pairs, new.astype(np.int32)
