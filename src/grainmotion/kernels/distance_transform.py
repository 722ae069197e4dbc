"""Distance of the voxels of a mask from the nearest one outside of it, exact, in voxels.

Squares of distances are the least, along each axis in turn, of those of the axes before plus the square of the step.
Few steps have to be tried: none longer than the largest distance found so far.
"""

from __future__ import annotations

import numba as nb
import numpy as np

from grainmotion.kernels.compilation import CACHE

_UNREACHED = 1e12
"""Square of a distance to nothing."""
_COLUMNS_TOGETHER = 64
"""Columns whose steps are tried together."""


@nb.njit(cache=CACHE, nogil=True)
def squares_in_plane(mask: np.ndarray, plane: int, squares: np.ndarray) -> None:
    """Squares of the distances within a plane, written into that plane of ``squares`` (float32)."""
    _, ny, nx = mask.shape
    work = np.empty((ny, nx), np.float32)
    for y in range(ny):
        row, last = mask[plane, y], -1
        for x in range(nx):
            if row[x] == 0:
                last = x
            work[y, x] = np.float32(x - last) if last >= 0 else np.float32(np.sqrt(_UNREACHED))
        last = -1
        for x in range(nx - 1, -1, -1):
            if row[x] == 0:
                last = x
            if last >= 0:
                work[y, x] = min(work[y, x], np.float32(last - x))
            work[y, x] *= work[y, x]
    _least_along(work, squares[plane])


@nb.njit(cache=CACHE, nogil=True)
def distances_along_z(squares: np.ndarray, row: int) -> None:
    """Distances of the row ``[:, row]`` of all planes from the squares within planes, in place."""
    nz, _, nx = squares.shape
    work = np.empty((nz, nx), np.float32)
    for z in range(nz):
        work[z] = squares[z, row]
    out = squares[:, row]
    _least_along(work, out)
    for z in range(nz):
        for x in range(nx):
            out[z, x] = np.sqrt(out[z, x])


@nb.njit(cache=CACHE, nogil=True)
def _least_along(work, out):
    """``out[i]`` becomes the least of ``work[j] + (i - j)²`` over all lines j."""
    n, columns = work.shape
    for left in range(0, columns, _COLUMNS_TOGETHER):
        right = min(left + _COLUMNS_TOGETHER, columns)
        for i in range(n):
            best = out[i, left:right]
            largest = np.float32(0)
            for c in range(right - left):
                best[c] = work[i, left + c]
                largest = max(largest, best[c])
            step = 1
            while largest > step * step and (step <= i or i + step < n):
                square = np.float32(step * step)
                if step <= i:
                    other = work[i - step, left:right]
                    for c in range(right - left):
                        best[c] = min(best[c], other[c] + square)
                if i + step < n:
                    other = work[i + step, left:right]
                    for c in range(right - left):
                        best[c] = min(best[c], other[c] + square)
                step += 1
                largest = np.float32(0)
                for c in range(right - left):
                    largest = max(largest, best[c])
