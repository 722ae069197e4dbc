"""Faces of voxels between labels: how many each pair has, and the values along them.

A table of pairs is three arrays, of a power of two of places: ``keys`` (0 for none, ``lower * width + higher`` of two
labels), ``sums (places, 4)`` (faces across z, y and x; a sum of whole numbers), ``tops (places, 5)`` (the four highest
of the lower values at each face, falling, and the higher value at the first of these, the highest of equal ones).  All
are the same whatever the order in which faces are met.
"""

from __future__ import annotations

import numba as nb
import numpy as np

from grainmotion.kernels.compilation import CACHE

_HASH = np.uint64(0x9E3779B97F4A7C15)


@nb.njit(cache=CACHE, nogil=True)
def empty_table(places: int):
    """A table without pairs."""
    keys, sums = np.zeros(places, np.int64), np.zeros((places, 4), np.int64)
    return keys, sums, np.full((places, 5), -np.inf, np.float32)


@nb.njit(cache=CACHE, nogil=True)
def add_faces(table, labels, values, marks, box, origin, width, surface):
    """Add the faces of the voxels of a box with the next ones along each axis, and return the table, which may grow.

    ``marks`` are whole numbers, whose sum
    over both sides is added up, on a box that starts at ``origin``; pass an empty array for none.  ``surface`` counts
    the faces of each label towards any other number, 0 as well.
    """
    keys, sums, tops = table
    used = np.count_nonzero(keys)
    nz, ny, nx = labels.shape
    dz, dy, dx = origin
    marked = marks.size > 0
    for z in range(box[0], box[1]):
        for y in range(box[2], box[3]):
            here = labels[z, y]
            for axis in range(3):
                if (axis == 0 and z + 1 == nz) or (axis == 1 and y + 1 == ny):
                    continue
                beside = labels[z + 1, y] if axis == 0 else labels[z, y + 1] if axis == 1 else here[1:]
                last = min(box[5], nx - 1) if axis == 2 else box[5]
                for x in range(box[4], last):
                    a, b = here[x], beside[x]
                    if a == b:
                        continue
                    if a > 0:
                        surface[a] += 1
                    if b > 0:
                        surface[b] += 1
                    if a <= 0 or b <= 0:
                        continue
                    if 2 * used >= len(keys):
                        keys, sums, tops = _grown(keys, sums, tops)
                    key = np.int64(min(a, b)) * width + max(a, b)
                    place = _place(keys, key)
                    if keys[place] == 0:
                        keys[place] = key
                        used += 1
                    z2, y2, x2 = z + (axis == 0), y + (axis == 1), x + (axis == 2)
                    sums[place, axis] += 1
                    if marked:
                        sums[place, 3] += marks[z - dz, y - dy, x - dx] + marks[z2 - dz, y2 - dy, x2 - dx]
                    one, other = values[z, y, x], values[z2, y2, x2]
                    _insert(tops[place], min(one, other), max(one, other))
    return keys, sums, tops


@nb.njit(cache=CACHE, nogil=True)
def add_faces_on_codes(labels: np.ndarray, codes: np.ndarray, first: int, last: int, faces: np.ndarray) -> None:
    """Add, for some planes, the faces of each label with voxels of other labels, by the codes of these."""
    nz, ny, nx = labels.shape
    for z in range(first, last):
        for y in range(ny):
            for x in range(nx):
                label = labels[z, y, x]
                if label <= 0:
                    continue
                if z > 0 and labels[z - 1, y, x] != label:
                    faces[label, codes[z - 1, y, x]] += 1
                if z + 1 < nz and labels[z + 1, y, x] != label:
                    faces[label, codes[z + 1, y, x]] += 1
                if y > 0 and labels[z, y - 1, x] != label:
                    faces[label, codes[z, y - 1, x]] += 1
                if y + 1 < ny and labels[z, y + 1, x] != label:
                    faces[label, codes[z, y + 1, x]] += 1
                if x > 0 and labels[z, y, x - 1] != label:
                    faces[label, codes[z, y, x - 1]] += 1
                if x + 1 < nx and labels[z, y, x + 1] != label:
                    faces[label, codes[z, y, x + 1]] += 1


@nb.njit(cache=CACHE, nogil=True)
def add_marks(labels: np.ndarray, marks: np.ndarray, sums: np.ndarray) -> None:
    """Add the marks of the voxels of a box to those of their labels; ``marks`` have a voxel more on each side."""
    nz, ny, nx = labels.shape
    for z in range(nz):
        for y in range(ny):
            for x in range(nx):
                if labels[z, y, x] > 0:
                    sums[labels[z, y, x]] += marks[z + 1, y + 1, x + 1]


@nb.njit(cache=CACHE, nogil=True)
def gather_pairs(keys: np.ndarray, sums: np.ndarray, tops: np.ndarray, start: np.ndarray):
    """Rows of equal keys, which follow each other from ``start`` on, made one each."""
    n = len(start)
    new_sums, new_tops = np.zeros((n, sums.shape[1]), sums.dtype), np.full((n, tops.shape[1]), -np.inf, tops.dtype)
    for k in range(n):
        stop = start[k + 1] if k + 1 < n else len(keys)
        for i in range(start[k], stop):
            new_sums[k] += sums[i]
            for rank in range(4):
                _insert(new_tops[k], tops[i, rank], tops[i, 4] if rank == 0 else -np.inf)
    return new_sums, new_tops


@nb.njit(cache=CACHE, nogil=True)
def _insert(top, value, higher):
    """Keep the highest of the lower values of faces, falling, and the higher value at the first."""
    if value > top[0]:
        top[4] = higher
    elif value == top[0]:
        top[4] = max(top[4], higher)
    k = 3
    if value <= top[k]:
        return
    while k > 0 and top[k - 1] < value:
        top[k] = top[k - 1]
        k -= 1
    top[k] = value


@nb.njit(cache=CACHE, nogil=True)
def _place(keys, key):
    mask = len(keys) - 1
    place = np.int64((np.uint64(key) * _HASH) >> np.uint64(20)) & mask
    while keys[place] != 0 and keys[place] != key:
        place = (place + 1) & mask
    return place


@nb.njit(cache=CACHE, nogil=True)
def _grown(keys, sums, tops):
    new_keys, new_sums, new_tops = empty_table(2 * len(keys))
    for i in range(len(keys)):
        if keys[i] != 0:
            place = _place(new_keys, keys[i])
            new_keys[place], new_sums[place], new_tops[place] = keys[i], sums[i], tops[i]
    return new_keys, new_sums, new_tops
