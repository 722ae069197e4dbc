"""Between voxels and voxels twice as large."""

from __future__ import annotations

import numpy as np

from grainmotion.packed import Image

COARSER = 2
"""Edge of a coarse voxel, fine voxels; of a coarse pixel, fine pixels."""


def finer(array: Image, shape: tuple[int, ...], planes: slice = slice(None)) -> Image:
    """Trilinear values at the middles of voxels half as large, ``shape`` of them around the same middle.

    ``planes`` picks some of them along z.
    """
    for axis, count in enumerate(shape):
        lines = np.moveaxis(array, axis, 0)
        # of an odd number of fine voxels the middle one lies on a coarse one's edge or middle
        at = (np.arange(count) - (count - 1) / 2) / COARSER + (len(lines) - 1) / 2
        at = at[planes] if axis == 0 else at
        low = np.clip(np.floor(at).astype(int), 0, max(len(lines) - 2, 0))
        weight = np.clip(at - low, 0, 1).astype(array.dtype).reshape(-1, 1, 1)
        high = np.minimum(low + 1, len(lines) - 1)
        array = np.moveaxis((1 - weight) * lines[low] + weight * lines[high], 0, axis)
    return np.ascontiguousarray(array)
