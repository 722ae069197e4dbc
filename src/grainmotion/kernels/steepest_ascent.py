"""Catchment basins: every voxel goes to its highest neighbour, and so on up to a voxel that has a label.

``labels`` are 0 or below -1 where nothing is sought, -1 where a label is wanted.  Where a voxel ends up does not depend
on the order in which voxels are visited, so blocks of a volume may be worked on at the same time, and paths lead
through all of them: what another thread has written in the meantime only shortens a path.
"""

from __future__ import annotations

import numba as nb
import numpy as np

from grainmotion.kernels.compilation import CACHE
from grainmotion.kernels.disjoint_sets import root_of

_PATH = 1024
"""Voxels of a path that are labelled at once."""


@nb.njit(cache=CACHE, nogil=True)
def find_peaks(values: np.ndarray, first: int, last: int) -> np.ndarray:
    """Places, in the flat array, of positive values of some planes that none of their 26 neighbours exceeds."""
    ny, nx = values.shape[1:]
    found, count = np.empty(256, np.int64), 0
    for z in range(first, last):
        for y in range(ny):
            row = values[z, y]
            for x in range(nx):
                value = row[x]
                if value <= 0 or (x > 0 and row[x - 1] > value) or (x + 1 < nx and row[x + 1] > value):
                    continue
                if _exceeded(values, z, y, x):
                    continue
                if count == len(found):
                    found = _longer(found)
                found[count] = (z * ny + y) * nx + x
                count += 1
    return found[:count]


@nb.njit(cache=CACHE, nogil=True)
def find_tops(values: np.ndarray, labels: np.ndarray, first: int, last: int) -> np.ndarray:
    """Places of voxels that want a label (-1) and have no higher neighbour to go to, of six, in some planes.

    Of equal values the one that comes first in the array is the higher one.
    """
    ny, nx = values.shape[1:]
    found, count = np.empty(256, np.int64), 0
    flat, numbers = values.reshape(-1), labels.reshape(-1)
    for place in range(first * ny * nx, last * ny * nx):
        if numbers[place] == -1 and _brightest(flat, numbers, place, values.shape) == place:
            if count == len(found):
                found = _longer(found)
            found[count] = place
            count += 1
    return found[:count]


@nb.njit(cache=CACHE, nogil=True)
def label_places(labels: np.ndarray, places: np.ndarray) -> int:
    """Label the voxels at rising places 1 … n, those that touch (of 26 neighbours) alike; returns n."""
    ny, nx = labels.shape[1:]
    flat, parents = labels.reshape(-1), np.arange(len(places) + 1)
    for i in range(len(places)):
        place = places[i]
        flat[place] = i + 1
        z, y, x = place // (ny * nx), place // nx % ny, place % nx
        for dz in range(-1, 1):
            for dy in range(-1, 2):
                for dx in range(-1, 2):
                    if (dz, dy, dx) >= (0, 0, 0) or z + dz < 0 or not (0 <= y + dy < ny and 0 <= x + dx < nx):
                        continue
                    other = labels[z + dz, y + dy, x + dx]
                    if other > 0:
                        one, two = root_of(parents, i + 1), root_of(parents, other)
                        parents[max(one, two)] = min(one, two)
    count = 0
    for i in range(1, len(parents)):
        if parents[i] == i:
            count += 1
            parents[i] = count
        else:
            parents[i] = parents[parents[i]]
        flat[places[i - 1]] = parents[i]
    return count


@nb.njit(cache=CACHE, nogil=True)
def climb_to_peaks(values: np.ndarray, labels: np.ndarray, first: int, last: int) -> None:
    """Label the voxels of some planes by the peak that steps to the highest neighbour lead to.

    The neighbour is one of six, or if none is higher, one of 26; of equal ones the one with the larger sum of its
    own 27, which halves the space between two peaks, then the first along -z, z, -y, y, -x, x.
    """
    ny, nx = values.shape[1:]
    flat, path = labels.reshape(-1), np.empty(_PATH, np.int64)
    for z in range(first, last):
        for y in range(ny):
            for x in range(nx):
                if labels[z, y, x] != -1:
                    continue
                place, steps = (z * ny + y) * nx + x, 0
                while flat[place] == -1:
                    if steps < _PATH:
                        path[steps] = place
                        steps += 1
                    place = _highest(values, place)
                label = flat[place]
                for k in range(steps):
                    flat[path[k]] = label


@nb.njit(cache=CACHE, nogil=True)
def climb_to_labels(values: np.ndarray, labels: np.ndarray, first: int, last: int) -> None:
    """Label the voxels of some planes by the label that steps to the highest of six neighbours lead to.

    Voxels without a higher neighbour (`find_tops`) have labels already.
    """
    ny, nx = values.shape[1:]
    heights, flat, path = values.reshape(-1), labels.reshape(-1), np.empty(_PATH, np.int64)
    for start in range(first * ny * nx, last * ny * nx):
        if flat[start] != -1:
            continue
        place, steps = start, 0
        while flat[place] == -1:
            if steps < _PATH:
                path[steps] = place
                steps += 1
            place = _brightest(heights, flat, place, values.shape)
        label = flat[place]
        for k in range(steps):
            flat[path[k]] = label


@nb.njit(cache=CACHE, nogil=True)
def _longer(found):
    new = np.empty(2 * len(found), np.int64)
    new[: len(found)] = found
    return new


@nb.njit(cache=CACHE, nogil=True)
def _exceeded(values, z, y, x):
    """Whether one of the 26 neighbours is higher."""
    nz, ny, nx = values.shape
    for k in range(max(z - 1, 0), min(z + 2, nz)):
        for j in range(max(y - 1, 0), min(y + 2, ny)):
            for i in range(max(x - 1, 0), min(x + 2, nx)):
                if values[k, j, i] > values[z, y, x]:
                    return True
    return False


@nb.njit(cache=CACHE, nogil=True)
def _highest(values, place):
    """The highest neighbour of a voxel that is no peak: one of six, or of 26 if none of these is higher."""
    nz, ny, nx = values.shape
    flat = values.reshape(-1)
    z, y, x = place // (ny * nx), place // nx % ny, place % nx
    best = place
    if z > 0:
        best = _steeper(values, flat, best, place - ny * nx, place)
    if z + 1 < nz:
        best = _steeper(values, flat, best, place + ny * nx, place)
    if y > 0:
        best = _steeper(values, flat, best, place - nx, place)
    if y + 1 < ny:
        best = _steeper(values, flat, best, place + nx, place)
    if x > 0:
        best = _steeper(values, flat, best, place - 1, place)
    if x + 1 < nx:
        best = _steeper(values, flat, best, place + 1, place)
    if best == place:
        for k in range(max(z - 1, 0), min(z + 2, nz)):
            for j in range(max(y - 1, 0), min(y + 2, ny)):
                for i in range(max(x - 1, 0), min(x + 2, nx)):
                    best = _steeper(values, flat, best, (k * ny + j) * nx + i, place)
    return best


@nb.njit(cache=CACHE, nogil=True)
def _steeper(values, flat, best, other, place):
    """The higher one of two places, the other one only if it is higher than the place they are seen from."""
    if flat[other] <= flat[place] or flat[other] < flat[best]:
        return best
    if flat[other] > flat[best] or _sum_around(values, other) > _sum_around(values, best):
        return other
    return best


@nb.njit(cache=CACHE, nogil=True)
def _sum_around(values, place):
    """Sum of a voxel and its 26 neighbours."""
    nz, ny, nx = values.shape
    z, y, x = place // (ny * nx), place // nx % ny, place % nx
    total = np.float32(0)
    for k in range(max(z - 1, 0), min(z + 2, nz)):
        for j in range(max(y - 1, 0), min(y + 2, ny)):
            for i in range(max(x - 1, 0), min(x + 2, nx)):
                total += values[k, j, i]
    return total


@nb.njit(cache=CACHE, nogil=True)
def _brightest(heights, labels, place, shape):
    """The highest of a voxel and its six neighbours but those of label 0; of equal ones the first in the array."""
    nz, ny, nx = shape
    z, y, x = place // (ny * nx), place // nx % ny, place % nx
    best = place
    if x + 1 < nx:
        best = _higher(heights, labels, place + 1, best)
    if y + 1 < ny:
        best = _higher(heights, labels, place + nx, best)
    if z + 1 < nz:
        best = _higher(heights, labels, place + ny * nx, best)
    if x > 0:
        best = _higher(heights, labels, place - 1, best)
    if y > 0:
        best = _higher(heights, labels, place - nx, best)
    if z > 0:
        best = _higher(heights, labels, place - ny * nx, best)
    return best


@nb.njit(cache=CACHE, nogil=True)
def _higher(heights, labels, place, best):
    """The higher one of two places, of which the first may be left out."""
    if labels[place] == 0 or labels[place] < -1:
        return best
    other, value = heights[place], heights[best]
    return place if other > value or (other == value and place < best) else best
