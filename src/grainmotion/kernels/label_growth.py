"""Labels grown into the voxels around them."""

from __future__ import annotations

import numba as nb
import numpy as np

from grainmotion.kernels.compilation import CACHE


@nb.njit(cache=CACHE, nogil=True)
def _nearest(labels, z, y, x, offsets):
    """The first label at one of the offsets; 0 if there is none."""
    nz, ny, nx = labels.shape
    for k in range(len(offsets)):
        a, b, c = z + offsets[k, 0], y + offsets[k, 1], x + offsets[k, 2]
        if 0 <= a < nz and 0 <= b < ny and 0 <= c < nx and labels[a, b, c] != 0:
            return labels[a, b, c]
    return labels[z, y, x]


@nb.njit(cache=CACHE, nogil=True)
def _grow_line(labels, offsets, steps, reach, z, y, first, out):
    """Voxels ``first … first + len(out) − 1`` of a line along x; ``steps`` are the offsets in the flat array."""
    nz, ny, nx = labels.shape
    flat = labels.ravel()
    inner = reach <= z < nz - reach and reach <= y < ny - reach
    for k in range(len(out)):
        x = first + k
        label = labels[z, y, x]
        if label == 0:
            if inner and reach <= x < nx - reach:  # no offset leaves the array
                at = (z * ny + y) * nx + x
                for step in steps:
                    label = flat[at + step]
                    if label != 0:
                        break
            else:
                label = _nearest(labels, z, y, x, offsets)
        out[k] = label


@nb.njit(parallel=True, cache=CACHE)
def _labelled_parts(labels, low, high):
    """Of each line along x of planes ``low … high − 1`` the first voxel with a label and the one after the last."""
    ny, nx = labels.shape[1:]
    out = np.zeros((high - low, ny, 2), np.int64)
    for row in nb.prange((high - low) * ny):
        line = labels[low + row // ny, row % ny]
        first, end = 0, nx
        while first < nx and line[first] == 0:
            first += 1
        while end > first and line[end - 1] == 0:
            end -= 1
        out[row // ny, row % ny, 0], out[row // ny, row % ny, 1] = first, end
    return out


@nb.njit(parallel=True, cache=CACHE)
def grow(labels, offsets, first, end, grown):
    """Give voxels without a label, in planes ``first … end − 1``, the first label that lies at one of the offsets.

    ``offsets (n, 3)`` are steps along z, y, x by rising length; ``grown`` gets the labels of those planes.
    """
    nz, ny, nx = labels.shape
    reach = np.abs(offsets).max()
    steps = (offsets[:, 0] * ny + offsets[:, 1]) * nx + offsets[:, 2]
    low, high = max(first - reach, 0), min(end + reach, nz)
    filled = _labelled_parts(labels, low, high)
    for row in nb.prange((end - first) * ny):
        z, y = row // ny, row % ny
        left, right = nx, 0  # the part of the line near which there are labels
        for a in range(max(first + z - reach, low), min(first + z + reach + 1, high)):
            for b in range(max(y - reach, 0), min(y + reach + 1, ny)):
                if filled[a - low, b, 0] < filled[a - low, b, 1]:
                    left, right = min(left, filled[a - low, b, 0]), max(right, filled[a - low, b, 1])
        left, right = max(left - reach, 0), min(right + reach, nx)
        line = grown[z, y]
        if left >= right:
            line[:] = 0
            continue
        line[:left], line[right:] = 0, 0
        _grow_line(labels, offsets, steps, reach, first + z, y, left, line[left:right])


@nb.njit(cache=CACHE, nogil=True)
def grow_box(labels, offsets, box, grown):
    """The same in a box ``(3, 2)``, from the first voxel to the one after the last along z, y, x, by one thread."""
    _, ny, nx = labels.shape
    reach = np.abs(offsets).max()
    steps = (offsets[:, 0] * ny + offsets[:, 1]) * nx + offsets[:, 2]
    for z in range(box[0, 0], box[0, 1]):
        for y in range(box[1, 0], box[1, 1]):
            line = grown[z - box[0, 0], y - box[1, 0]]
            _grow_line(labels, offsets, steps, reach, z, y, box[2, 0], line)
