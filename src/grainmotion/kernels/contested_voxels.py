"""Finer voxels between a grain and others, given to one of them by flooding in the order of attenuation.

Crops are in voxels of the reference; finer voxels are ``factor`` to one of these along each axis.  A voxel is contested
if it has a label, and another one is near.
"""

from __future__ import annotations

import numba as nb
import numpy as np

from grainmotion.kernels.compilation import CACHE

OUTSIDE, OWN_KIND, OTHER_KIND, WANTING = 0, 1, 2, 3
"""Of a finer voxel: no grain's, the grain's, another one's, or one of these, which flooding decides."""
FLOOD_LEVELS = 1 << 14
"""Steps of attenuation in which voxels are flooded."""
_BEYOND_CROP = -1
"""Label beyond the edges of a crop, of which nothing is known."""


@nb.njit(cache=CACHE, nogil=True)
def find_contested(grown: np.ndarray, distance: int) -> np.ndarray:
    """Labelled voxels with another label within a distance along every axis."""
    nz, ny, nx = grown.shape
    highest, lowest = grown.copy(), grown.copy()
    lows, beyond = lowest.reshape(-1), np.iinfo(np.int32).max
    for i in range(len(lows)):
        if lows[i] == 0:
            lows[i] = beyond
    for y in range(ny):
        _extremes(highest[:, y], lowest[:, y], distance)
    out = np.empty(grown.shape, np.bool_)
    high, low = np.empty(nx, np.int32), np.empty(nx, np.int32)
    for z in range(nz):
        _extremes(highest[z], lowest[z], distance)
        for y in range(ny):
            highs, lows, here = highest[z, y], lowest[z, y], grown[z, y]
            high[:], low[:] = highs, lows
            for step in range(1, min(distance + 1, nx)):
                for x in range(nx - step):
                    high[x], low[x] = max(high[x], highs[x + step]), min(low[x], lows[x + step])
                for x in range(step, nx):
                    high[x], low[x] = max(high[x], highs[x - step]), min(low[x], lows[x - step])
            for x in range(nx):
                out[z, y, x] = (low[x] < high[x]) & (here[x] > 0)
    return out


@nb.njit(cache=CACHE, nogil=True)
def _extremes(highest, lowest, distance):
    """Highest and lowest values up to a distance along the first axis, in place."""
    n, columns = highest.shape
    highs, lows = highest.copy(), lowest.copy()
    for i in range(n):
        high, low = highest[i], lowest[i]
        for k in range(max(i - distance, 0), min(i + distance + 1, n)):
            one, other = highs[k], lows[k]
            for c in range(columns):
                high[c] = max(high[c], one[c])
                low[c] = min(low[c], other[c])


@nb.njit(cache=CACHE, nogil=True)
def find_near(grown: np.ndarray, label: int, distance: int) -> np.ndarray:
    """Voxels with a label up to a distance away along every axis."""
    nz, ny, nx = grown.shape
    out = np.empty(grown.shape, np.bool_)
    for z in range(nz):
        for y in range(ny):
            last, row, target = -distance - 1, grown[z, y], out[z, y]
            for x in range(nx):
                last = x if row[x] == label else last
                target[x] = x - last <= distance
            last = nx + distance
            for x in range(nx - 1, -1, -1):
                last = x if row[x] == label else last
                target[x] |= last - x <= distance
        _any_along(out[z], distance)
    for y in range(ny):
        _any_along(out[:, y], distance)
    return out


@nb.njit(cache=CACHE, nogil=True)
def _any_along(mask, distance):
    """Whether any is set up to a distance along the first axis, in place."""
    n, columns = mask.shape
    before = mask.copy()
    for i in range(n):
        target = mask[i]
        for k in range(max(i - distance, 0), min(i + distance + 1, n)):
            other = before[k]
            for c in range(columns):
                target[c] |= other[c]


@nb.njit(cache=CACHE, nogil=True)
def known_labels(labels: np.ndarray, grown: np.ndarray, contested: np.ndarray) -> np.ndarray:
    """The labels of contested voxels and the grown ones of others, with a layer around of which nothing is known."""
    nz, ny, nx = grown.shape
    out = np.full((nz + 2, ny + 2, nx + 2), _BEYOND_CROP, np.int32)
    for z in range(nz):
        for y in range(ny):
            for x in range(nx):
                out[z + 1, y + 1, x + 1] = labels[z, y, x] if contested[z, y, x] else grown[z, y, x]
    return out


@nb.njit(cache=CACHE, nogil=True)
def sure_depths(known: np.ndarray, contested: np.ndarray, share: float, squares: np.ndarray) -> np.ndarray:
    """Square of the depth from which a finer voxel is sure to have its label, for each label.

    That is more than a voxel of the reference, or ``share`` of the largest depth of a label that is nowhere so deep.
    """
    nz, ny, nx = contested.shape
    deepest, depths = np.zeros(known.max() + 1, np.int64), np.empty(squares.shape[1], np.int64)
    sure = squares.max() // 3 + 1
    for z in range(nz):
        for y in range(ny):
            for x in range(nx):
                own = known[z + 1, y + 1, x + 1]
                if own == 0 or deepest[own] >= sure:
                    continue
                if not contested[z, y, x]:
                    deepest[own] = sure
                    continue
                _depths(known, z + 1, y + 1, x + 1, squares, depths)
                deepest[own] = max(deepest[own], min(depths.max(), sure))
    for own in range(len(deepest)):
        deepest[own] = sure if deepest[own] >= sure else int(np.ceil(share**2 * deepest[own]))
    return deepest


@nb.njit(cache=CACHE, nogil=True)
def classes(
    known: np.ndarray, grown: np.ndarray, wanting: np.ndarray, label: int, least: np.ndarray, squares: np.ndarray
) -> np.ndarray:
    """What is known of each finer voxel before flooding.

    Parameters
    ----------
    known : (nz + 2, ny + 2, nx + 2) int32 array
        Of `known_labels`.
    grown : (nz, ny, nx) int32 array
        Labels with the voxels around them.
    wanting : (nz, ny, nx) bool array
        Where finer voxels want a label, unless they have one and lie deep enough in it.
    label : int
        Of the grain.
    least : (n,) int array
        Of `sure_depths`.
    squares : (27, factor³) int array
        Of `squared_steps`.

    Returns
    -------
    (factor nz + 2, …) uint8 array
        With a layer of `OUTSIDE` around the crop.
    """
    nz, ny, nx = grown.shape
    factor = int(np.rint(squares.shape[1] ** (1 / 3)))
    out = np.zeros((factor * nz + 2, factor * ny + 2, factor * nx + 2), np.uint8)
    kinds = np.empty((factor, factor, factor), np.uint8)
    each, depths = kinds.reshape(-1), np.empty(factor**3, np.int64)
    for z in range(nz):
        for y in range(ny):
            for x in range(nx):
                if grown[z, y, x] == 0:
                    continue
                own = known[z + 1, y + 1, x + 1]
                each[:] = WANTING
                if not wanting[z, y, x]:
                    each[:] = OWN_KIND if grown[z, y, x] == label else OTHER_KIND
                elif own > 0:
                    _depths(known, z + 1, y + 1, x + 1, squares, depths)
                    for k in range(len(each)):
                        if depths[k] >= least[own]:
                            each[k] = OWN_KIND if own == label else OTHER_KIND
                for a in range(factor):
                    for b in range(factor):
                        for c in range(factor):
                            out[factor * z + a + 1, factor * y + b + 1, factor * x + c + 1] = kinds[a, b, c]
    return out


@nb.njit(cache=CACHE, nogil=True)
def squared_steps(factor: int) -> np.ndarray:
    """Squares of the distances of the finer voxels of a voxel from each of the 27 around it, in finer voxels."""
    out = np.zeros((27, factor**3), np.int64)
    for d in range(27):
        for k in range(factor**3):
            step, place = d, k
            for _ in range(3):
                side, inner = step % 3 - 1, place % factor
                away = factor - inner if side == 1 else inner + 1 if side == -1 else 0
                out[d, k] += away * away
                step, place = step // 3, place // factor
    return out


@nb.njit(cache=CACHE, nogil=True)
def _depths(known, z, y, x, squares, out):
    """Squares of the distances of the finer voxels of a voxel from other labels, as far as these touch it."""
    out[:] = np.iinfo(np.int64).max
    own, count = known[z, y, x], len(out)
    for d in range(27):
        other = known[z + d // 9 - 1, y + d // 3 % 3 - 1, x + d % 3 - 1]
        if other != own and other != _BEYOND_CROP:
            for k in range(count):
                out[k] = min(out[k], squares[d, k])


@nb.njit(cache=CACHE, nogil=True)
def levels_of(values: np.ndarray, low: float, high: float) -> np.ndarray:
    """Steps of values between two of them, with a layer around as `classes` has it."""
    nz, ny, nx = values.shape
    out = np.zeros((nz + 2, ny + 2, nx + 2), np.uint16)
    first, scale = np.float32(low), np.float32((FLOOD_LEVELS - 1) / max(high - low, 1e-30))
    for z in range(nz):
        for y in range(ny):
            row, target = values[z, y], out[z + 1, y + 1, 1:]
            for x in range(nx):
                level = (np.float32(row[x]) - first) * scale
                target[x] = np.int32(min(max(level, np.float32(0)), np.float32(FLOOD_LEVELS - 1)))
    return out


@nb.njit(cache=CACHE, nogil=True)
def flood(kinds: np.ndarray, levels: np.ndarray) -> None:
    """Give voxels that want it the kind of the neighbour, of six, from which a flood reaches them first.

    Parameters
    ----------
    kinds : (nz, ny, nx) uint8 array
        Of `classes`; changed.  What no flood reaches still wants its kind.
    levels : (nz, ny, nx) uint16 array
        Below `FLOOD_LEVELS`.  The highest are flooded first.
    """
    ny, nx = kinds.shape[1:]
    flat, heights = kinds.reshape(-1), levels.reshape(-1)
    plane, row = ny * nx, nx
    following, top = np.empty(len(flat), np.int32), np.int64(-1)
    firsts, lasts = np.full(FLOOD_LEVELS, -1, np.int32), np.full(FLOOD_LEVELS, -1, np.int32)
    for place in range(plane, len(flat) - plane):
        if flat[place] != OWN_KIND and flat[place] != OTHER_KIND:
            continue
        if (
            flat[place - 1] == WANTING
            or flat[place + 1] == WANTING
            or flat[place - row] == WANTING
            or flat[place + row] == WANTING
            or flat[place - plane] == WANTING
            or flat[place + plane] == WANTING
        ):
            top = max(top, _append(place, heights, firsts, lasts, following))
    while top >= 0:
        first = np.int64(firsts[top])
        if first < 0:
            top -= 1
            continue
        firsts[top] = following[first]
        kind = flat[first]
        for step in (-plane, -row, -1, 1, row, plane):
            other = first + step
            if flat[other] == WANTING:
                flat[other] = kind
                top = max(top, _append(other, heights, firsts, lasts, following))


@nb.njit(cache=CACHE, nogil=True)
def _append(place, heights, firsts, lasts, following):
    """Put a place at the end of the line of its level."""
    level = np.int64(heights[place])
    following[place] = -1
    if firsts[level] < 0:
        firsts[level] = place
    else:
        following[lasts[level]] = place
    lasts[level] = place
    return level


@nb.njit(cache=CACHE, nogil=True)
def own_limits(kinds: np.ndarray) -> np.ndarray:
    """First and last (excluded) finer voxel of the grain along z, y, x ``(3, 2)``, the layer around it not counted."""
    nz, ny, nx = kinds.shape
    out = np.array([[nz, 0], [ny, 0], [nx, 0]])
    for z in range(1, nz - 1):
        for y in range(1, ny - 1):
            first, last = nx, 0
            for x in range(1, nx - 1):
                if kinds[z, y, x] == OWN_KIND:
                    first, last = min(first, x), x
            if last > 0:
                for axis, (low, high) in enumerate(((z, z), (y, y), (first, last))):
                    out[axis, 0], out[axis, 1] = min(out[axis, 0], low - 1), max(out[axis, 1], high)
    return out


@nb.njit(cache=CACHE, nogil=True)
def keep_own(values: np.ndarray, kinds: np.ndarray) -> None:
    """Set the values of finer voxels that are not the grain's to zero; both of the same box."""
    nz, ny, nx = values.shape
    for z in range(nz):
        for y in range(ny):
            row, kind = values[z, y], kinds[z, y]
            for x in range(nx):
                row[x] = row[x] if kind[x] == OWN_KIND else 0
