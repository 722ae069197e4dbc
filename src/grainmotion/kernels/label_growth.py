"""Labels grown into the voxels around them."""

from __future__ import annotations

import numba as nb
import numpy as np

from grainmotion.kernels.compilation import CACHE


@nb.njit(cache=CACHE)
def _nearest(labels, z, y, x, offsets):
    """The first label at one of the offsets; 0 if there is none."""
    nz, ny, nx = labels.shape
    for k in range(len(offsets)):
        a, b, c = z + offsets[k, 0], y + offsets[k, 1], x + offsets[k, 2]
        if 0 <= a < nz and 0 <= b < ny and 0 <= c < nx and labels[a, b, c] != 0:
            return labels[a, b, c]
    return labels[z, y, x]


@nb.njit(parallel=True, cache=CACHE)
def grow(labels, offsets, first, end, grown):
    """Give voxels without a label, in planes ``first … end − 1``, the first label that lies at one of the offsets.

    ``offsets (n, 3)`` are steps along z, y, x by rising length; ``grown`` gets the labels of those planes.
    """
    nz, ny, nx = labels.shape
    flat = labels.ravel()
    reach = np.abs(offsets).max()
    steps = (offsets[:, 0] * ny + offsets[:, 1]) * nx + offsets[:, 2]
    for row in nb.prange((end - first) * ny):
        z, y = first + row // ny, row % ny
        inner = reach <= z < nz - reach and reach <= y < ny - reach
        for x in range(nx):
            label = labels[z, y, x]
            if label == 0:
                if inner and reach <= x < nx - reach:  # no offset leaves the array
                    at = (z * ny + y) * nx + x
                    for k in range(len(steps)):
                        label = flat[at + steps[k]]
                        if label != 0:
                            break
                else:
                    label = _nearest(labels, z, y, x, offsets)
            grown[z, y, x] = label
