"""Basins of a distance merged over the graph of those that touch (`segmentation.region_merging`)."""

from __future__ import annotations

import heapq
import math

import numba as nb
import numpy as np

from grainmotion.kernels.compilation import CACHE
from grainmotion.kernels.disjoint_sets import root_of


@nb.njit(cache=CACHE, nogil=True)
def merge_shallow(
    peaks: np.ndarray, pairs: np.ndarray, saddles: np.ndarray, order: np.ndarray, depth: float, share: float
) -> np.ndarray:
    """Of each basin the one whose peak is the highest of all that it is merged with.

    Pairs are taken in the given order, each merged if the lower peak rises by less than ``depth`` above their saddle,
    or the saddle is higher than this share of it.
    """
    parents, highest = np.arange(len(peaks)), np.arange(len(peaks))
    for k in order:
        one, two = root_of(parents, pairs[k, 0]), root_of(parents, pairs[k, 1])
        a, b = highest[one], highest[two]
        low, high = (a, b) if peaks[a] < peaks[b] else (b, a)
        if one != two and (peaks[low] - saddles[k] < depth or saddles[k] > share * peaks[low]):
            parents[two] = one
            highest[one] = high
    for basin in range(len(parents)):
        parents[basin] = root_of(parents, basin)
    return highest[parents]


@nb.njit(cache=CACHE, nogil=True)
def merge_necks(
    peaks: np.ndarray,
    pairs: np.ndarray,
    necks: tuple[np.ndarray, np.ndarray, np.ndarray],
    basins: tuple[np.ndarray, np.ndarray],
    least: float,
    noise: float,
    valley: tuple[float, float],
) -> np.ndarray:
    """Of each basin the first of all that it is merged with, those with the stiffest neck first.

    Parameters
    ----------
    peaks : (n + 1,) array
        Highest distance of each basin, voxels; changed.
    pairs : (k, 2) int array
        Basins that touch, each pair once; changed.
    necks : (k,), (k, 3) and (k,) arrays
        Saddle of each pair, faces along z, y, x, and sum of the deficits along them; changed.
    basins : two (n + 1,) arrays
        Sum of the deficits of each basin, and its voxels; changed.
    least : float
        Stiffness of a neck, over that of the smaller basin, from which they are merged.
    noise : float
        Of the mean deficit of a neck, times the root of its faces.
    valley : (float, float)
        Deficits from none up to an open valley.
    """
    count = len(peaks)
    parents, version, queue = np.arange(count), np.zeros(count, np.int64), [(0.0, 0, 0, 0, 0)]
    first, after, alive = np.full(count, -1), np.full(2 * len(pairs), -1), np.ones(len(pairs), np.bool_)
    for end in range(2 * len(pairs)):  # the ends of pairs at each basin are a list
        basin = pairs[end // 2, end % 2]
        after[end], first[basin] = first[basin], end
    queue.pop()
    for k in range(len(pairs)):
        _offer(queue, k, peaks, pairs, necks, basins, version, least, noise, valley)
    pair_with, mark = np.zeros(count, np.int64), np.full(count, -1)
    merged = 0
    while len(queue) > 0:
        _, a, b, before_a, before_b = heapq.heappop(queue)
        if version[a] != before_a or version[b] != before_b:
            continue
        peaks[a] = max(peaks[a], peaks[b])
        for values in basins:
            values[a] += values[b]
        parents[b], version[a], version[b] = a, version[a] + 1, -1
        _drop_dead(first, after, alive, a)
        end = first[a]
        while end >= 0:
            other = pairs[end // 2, 1 - end % 2]
            pair_with[other], mark[other] = end // 2, merged
            end = after[end]
        end = first[b]
        while end >= 0:
            pair, following = end // 2, after[end]
            other = pairs[pair, 1 - end % 2]
            if alive[pair] and (other == a or mark[other] == merged):
                alive[pair] = False
                if other != a:
                    _join(necks, pair_with[other], pair)
            elif alive[pair]:
                pairs[pair, end % 2] = a
                after[end], first[a] = first[a], end
            end = following
        merged += 1
        _drop_dead(first, after, alive, a)
        end = first[a]
        while end >= 0:
            _offer(queue, end // 2, peaks, pairs, necks, basins, version, least, noise, valley)
            end = after[end]
    for basin in range(count):
        parents[basin] = root_of(parents, basin)
    return parents


@nb.njit(cache=CACHE, nogil=True)
def _offer(queue, pair, peaks, pairs, necks, basins, version, least, noise, valley):
    """Put a pair with a stiff neck into the queue."""
    saddles, faces, faint = necks
    sums, voxels = basins
    a, b = min(pairs[pair, 0], pairs[pair, 1]), max(pairs[pair, 0], pairs[pair, 1])
    # the norm of the numbers of faces is the area of a flat neck of any orientation
    area = math.sqrt(faces[pair, 0] ** 2 + faces[pair, 1] ** 2 + faces[pair, 2] ** 2)
    kappa = saddles[pair] ** 2 * area / (math.pi * math.pow(min(peaks[a], peaks[b]), 4.0))
    if kappa < least:
        return
    total = faces[pair, 0] + faces[pair, 1] + faces[pair, 2]
    around = min(sums[a] / voxels[a], sums[b] / voxels[b])
    deficit = faint[pair] / total - around - noise / math.sqrt(total)
    kappa *= min(max((valley[1] - deficit) / (valley[1] - valley[0]), 0.0), 1.0)
    if kappa >= least:
        heapq.heappush(queue, (-kappa, a, b, version[a], version[b]))


@nb.njit(cache=CACHE, nogil=True)
def _join(necks, pair, other):
    """Add another neck of the same two basins."""
    saddles, faces, faint = necks
    saddles[pair] = max(saddles[pair], saddles[other])
    faces[pair] += faces[other]
    faint[pair] += faint[other]


@nb.njit(cache=CACHE, nogil=True)
def _drop_dead(first, after, alive, basin):
    """Take pairs that are no more out of a basin's list."""
    while first[basin] >= 0 and not alive[first[basin] // 2]:
        first[basin] = after[first[basin]]
    end = first[basin]
    while end >= 0:
        while after[end] >= 0 and not alive[after[end] // 2]:
            after[end] = after[after[end]]
        end = after[end]
