"""Regions without a label, joined along the highest passes between them (Borůvka's algorithm).

Regions 1 … ``labelled`` have labels, others want one; ``joined`` says to which region each belongs by now.  A pass is a
face between two voxels: the higher its lower voxel is, then its higher one, then the earlier in the array, the higher
is the pass.  No two are equally high, so that the result is one and the same in whatever order passes are met.
"""

from __future__ import annotations

import numba as nb
import numpy as np

from grainmotion.kernels.compilation import CACHE
from grainmotion.kernels.disjoint_sets import root_of


@nb.njit(cache=CACHE, nogil=True)
def wanting_range(labels: np.ndarray, joined: np.ndarray, labelled: int) -> tuple[int, int]:
    """The lowest and the highest region without a label in flat ``labels``; the latter is below the former of none."""
    low, high = len(joined), -1
    for i in range(len(labels)):
        if labels[i] > 0:
            region = joined[labels[i]]
            if region > labelled:
                low, high = min(low, region), max(high, region)
    return low, high


@nb.njit(cache=CACHE, nogil=True)
def find_passes(
    labels: np.ndarray,
    heights: np.ndarray,
    joined: np.ndarray,
    labelled: int,
    planes: tuple[int, int],
    first: int,
    lows: np.ndarray,
    highs: np.ndarray,
    faces: np.ndarray,
) -> None:
    """Raise the highest pass of regions from ``first`` on by the faces of some planes with the next voxels.

    ``lows`` and ``highs`` are its lower and higher voxel, ``faces`` its place: thrice that of the first voxel, and
    the axis; -1 of none.
    """
    nz, ny, nx = labels.shape
    for z in range(planes[0], planes[1]):
        for y in range(ny):
            here = labels[z, y]
            for axis in range(3):
                if (axis == 0 and z + 1 == nz) or (axis == 1 and y + 1 == ny):
                    continue
                beside = labels[z + 1, y] if axis == 0 else labels[z, y + 1] if axis == 1 else here[1:]
                for x in range(nx - 1 if axis == 2 else nx):
                    if here[x] <= 0 or beside[x] <= 0 or here[x] == beside[x]:
                        continue
                    one, other = joined[here[x]], joined[beside[x]]
                    if one == other or (one <= labelled and other <= labelled):
                        continue
                    value = heights[z, y, x]
                    second = heights[z + (axis == 0), y + (axis == 1), x + (axis == 2)]
                    low, high = min(value, second), max(value, second)
                    face = ((z * ny + y) * nx + x) * 3 + axis
                    if one > labelled:
                        raise_pass(one - first, low, high, face, lows, highs, faces)
                    if other > labelled:
                        raise_pass(other - first, low, high, face, lows, highs, faces)


@nb.njit(cache=CACHE, nogil=True)
def raise_pass(
    region: int, low: float, high: float, face: int, lows: np.ndarray, highs: np.ndarray, faces: np.ndarray
) -> None:
    """Put a pass in the place of a region's, if it is higher."""
    if face < 0:
        return
    if faces[region] >= 0:
        if low < lows[region] or (low == lows[region] and high < highs[region]):
            return
        if low == lows[region] and high == highs[region] and face > faces[region]:
            return
    lows[region], highs[region], faces[region] = low, high, face


@nb.njit(cache=CACHE, nogil=True)
def raise_passes(
    first: int,
    found: tuple[np.ndarray, np.ndarray, np.ndarray],
    lows: np.ndarray,
    highs: np.ndarray,
    faces: np.ndarray,
) -> None:
    """Raise the passes of regions by those found of the ones from ``first`` on."""
    for k in range(len(found[2])):
        raise_pass(first + k, found[0][k], found[1][k], found[2][k], lows, highs, faces)


@nb.njit(cache=CACHE, nogil=True)
def join_along(labels: np.ndarray, joined: np.ndarray, labelled: int, faces: np.ndarray) -> bool:
    """Join each region without a label with the one beyond its pass, in ``joined``; whether any was joined."""
    ny, nx = labels.shape[1:]
    flat, parents, changed = labels.reshape(-1), np.arange(len(joined)), False
    for region in range(labelled + 1, len(faces)):
        if faces[region] >= 0:
            place, axis = faces[region] // 3, faces[region] % 3
            beyond = place + (ny * nx if axis == 0 else nx if axis == 1 else 1)
            one, other = root_of(parents, joined[flat[place]]), root_of(parents, joined[flat[beyond]])
            if one != other:
                parents[max(one, other)] = min(one, other)
                changed = True
    for k in range(len(joined)):
        joined[k] = root_of(parents, joined[k])
    return changed
