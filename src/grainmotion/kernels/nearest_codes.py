"""The code of the nearest voxel that is wanted, for every voxel, by exact distances (see `distance_transform`)."""

from __future__ import annotations

import numba as nb
import numpy as np

from grainmotion.kernels.compilation import CACHE

_UNREACHED = 1e12
"""Square of a distance to nothing."""
_COLUMNS_TOGETHER = 64
"""Columns whose steps are tried together."""


@nb.njit(cache=CACHE, nogil=True)
def nearest_in_plane(
    wanted: np.ndarray, codes: np.ndarray, plane: int, squares: np.ndarray, nearest: np.ndarray
) -> None:
    """Squares of the distances to the nearest wanted voxel of the same plane, and its code."""
    _, ny, nx = wanted.shape
    work, found = np.empty((ny, nx), np.float32), np.zeros((ny, nx), codes.dtype)
    for y in range(ny):
        last = -1
        for x in range(nx):
            if wanted[plane, y, x]:
                last = x
            work[y, x] = np.float32(x - last) ** 2 if last >= 0 else np.float32(_UNREACHED)
            if last >= 0:
                found[y, x] = codes[plane, y, last]
        last = -1
        for x in range(nx - 1, -1, -1):
            if wanted[plane, y, x]:
                last = x
            square = np.float32(last - x) ** 2
            if last >= 0 and square < work[y, x]:
                work[y, x], found[y, x] = square, codes[plane, y, last]
    _nearest_along(work, found, squares[plane], nearest[plane])


@nb.njit(cache=CACHE, nogil=True)
def nearest_along_z(squares: np.ndarray, nearest: np.ndarray, row: int) -> None:
    """The nearest codes in all planes, of the row ``[:, row]``, from those within planes, in place."""
    work, found = squares[:, row].copy(), nearest[:, row].copy()
    _nearest_along(work, found, squares[:, row], nearest[:, row])


@nb.njit(cache=CACHE, nogil=True)
def _nearest_along(work, codes, out, nearest):
    """``out[i]`` becomes the least of ``work[j] + (i - j)²`` over all lines j, and ``nearest[i]`` the code there."""
    n, columns = work.shape
    for left in range(0, columns, _COLUMNS_TOGETHER):
        right = min(left + _COLUMNS_TOGETHER, columns)
        for i in range(n):
            best, code = out[i, left:right], nearest[i, left:right]
            largest = np.float32(0)
            for c in range(right - left):
                best[c], code[c] = work[i, left + c], codes[i, left + c]
                largest = max(largest, best[c])
            step = 1
            while largest > step * step and (step <= i or i + step < n):
                square = np.float32(step * step)
                for j in (i - step, i + step):
                    if 0 <= j < n:
                        for c in range(right - left):
                            if work[j, left + c] + square < best[c]:
                                best[c], code[c] = work[j, left + c] + square, codes[j, left + c]
                step += 1
                largest = np.float32(0)
                for c in range(right - left):
                    largest = max(largest, best[c])
