"""Filters of one block of a volume, which holds as many voxels more on each side as the filter reaches.

Each value is the same whatever block it is computed in: sums are taken in one fixed order.
"""

from __future__ import annotations

import numba as nb
import numpy as np

from grainmotion.kernels.compilation import CACHE


@nb.njit(cache=CACHE, nogil=True)
def gather_block(
    array: np.ndarray, planes: np.ndarray, rows: np.ndarray, columns: np.ndarray, beyond: float, out: np.ndarray
) -> None:
    """Copy ``array[planes][:, rows][:, :, columns]``; what lies ``beyond`` the array has negative indices."""
    nx = len(columns)
    for i in range(len(planes)):
        for j in range(len(rows)):
            if planes[i] < 0 or rows[j] < 0:
                out[i, j] = beyond
                continue
            source, target = array[planes[i], rows[j]], out[i, j]
            for k in range(nx):
                column = columns[k]
                target[k] = source[column] if column >= 0 else beyond


@nb.njit(cache=CACHE, nogil=True)
def smooth_block(block: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Filter by a symmetric half-kernel along z, y and x; the result is smaller by its reach on each side."""
    reach = len(weights) - 1
    nz, ny, nx = block.shape
    along_z = np.empty((nz - 2 * reach, ny, nx), np.float32)
    line = np.empty(nx, np.float64)
    for z in range(nz - 2 * reach):
        for y in range(ny):
            for x in range(nx):
                line[x] = block[z + reach, y, x] * weights[0]
            for k in range(reach, 0, -1):
                low, high, weight = block[z + reach - k, y], block[z + reach + k, y], weights[k]
                for x in range(nx):
                    line[x] += (np.float64(low[x]) + np.float64(high[x])) * weight
            for x in range(nx):
                along_z[z, y, x] = line[x]
    out = np.empty((nz - 2 * reach, ny - 2 * reach, nx - 2 * reach), np.float32)
    rows = np.empty(nx, np.float32)
    for z in range(out.shape[0]):
        for y in range(out.shape[1]):
            for x in range(nx):
                line[x] = along_z[z, y + reach, x] * weights[0]
            for k in range(reach, 0, -1):
                low, high, weight = along_z[z, y + reach - k], along_z[z, y + reach + k], weights[k]
                for x in range(nx):
                    line[x] += (np.float64(low[x]) + np.float64(high[x])) * weight
            for x in range(nx):
                rows[x] = line[x]
            target = out[z, y]
            for x in range(len(target)):
                line[x] = rows[x + reach] * weights[0]
            for k in range(reach, 0, -1):
                low, high, weight = rows[reach - k :], rows[reach + k :], weights[k]
                for x in range(len(target)):
                    line[x] += (np.float64(low[x]) + np.float64(high[x])) * weight
            for x in range(len(target)):
                target[x] = line[x]
    return out


@nb.njit(cache=CACHE, nogil=True)
def range_block(block: np.ndarray) -> np.ndarray:
    """Range of the 27 voxels around each; the result is smaller by a voxel on each side."""
    nz, ny, nx = block.shape
    out = np.empty((nz - 2, ny - 2, nx - 2), np.float32)
    high, low = np.empty((3, ny, nx), np.float32), np.empty((3, ny, nx), np.float32)
    for z in range(nz):
        here_high, here_low = high[z % 3], low[z % 3]  # of nine voxels in the plane
        for y in range(1, ny - 1):
            for x in range(nx):
                a, b, c = block[z, y - 1, x], block[z, y, x], block[z, y + 1, x]
                here_high[0, x] = max(max(a, b), c)  # the first row is not used otherwise
                here_low[0, x] = min(min(a, b), c)
            for x in range(1, nx - 1):
                here_high[y, x] = max(max(here_high[0, x - 1], here_high[0, x]), here_high[0, x + 1])
                here_low[y, x] = min(min(here_low[0, x - 1], here_low[0, x]), here_low[0, x + 1])
        if z < 2:
            continue
        for y in range(ny - 2):
            for x in range(nx - 2):
                top = max(max(high[0, y + 1, x + 1], high[1, y + 1, x + 1]), high[2, y + 1, x + 1])
                bottom = min(min(low[0, y + 1, x + 1], low[1, y + 1, x + 1]), low[2, y + 1, x + 1])
                out[z - 2, y, x] = top - bottom
    return out


@nb.njit(cache=CACHE, nogil=True)
def sum_block(block: np.ndarray, window: int) -> np.ndarray:
    """Sums over cubes of an odd edge; the result is smaller by half the edge on each side."""
    cut = window - 1
    nz, ny, nx = block.shape
    along_z = np.zeros((nz - cut, ny, nx), np.float32)
    for z in range(nz - cut):
        for k in range(window):
            for y in range(ny):
                source, target = block[z + k, y], along_z[z, y]
                for x in range(nx):
                    target[x] += source[x]
    out = np.zeros((nz - cut, ny - cut, nx - cut), np.float32)
    line = np.empty(nx, np.float32)
    for z in range(nz - cut):
        for y in range(ny - cut):
            line[:] = 0
            for k in range(window):
                source = along_z[z, y + k]
                for x in range(nx):
                    line[x] += source[x]
            target = out[z, y]
            for k in range(window):
                shifted = line[k:]
                for x in range(nx - cut):
                    target[x] += shifted[x]
    return out


@nb.njit(cache=CACHE, nogil=True)
def erode_block(mask: np.ndarray) -> np.ndarray:
    """Voxels of a uint8 mask whose six neighbours are in it, too; smaller by a voxel on each side."""
    nz, ny, nx = mask.shape
    out = np.empty((nz - 2, ny - 2, nx - 2), np.uint8)
    for z in range(nz - 2):
        for y in range(ny - 2):
            here, target = mask[z + 1, y + 1], out[z, y]
            below, above, before, after = mask[z, y + 1], mask[z + 2, y + 1], mask[z + 1, y], mask[z + 1, y + 2]
            for x in range(nx - 2):
                across = below[x + 1] & above[x + 1] & before[x + 1] & after[x + 1]
                target[x] = here[x] & here[x + 1] & here[x + 2] & across
    return out


@nb.njit(cache=CACHE, nogil=True)
def half_way_block(
    regions: np.ndarray, values: np.ndarray, fixed: np.ndarray, levels: np.ndarray, sweeps: int
) -> np.ndarray:
    """Regions whose voxels may take a neighbour's region if its level is nearer to their value, in some sweeps.

    ``levels`` are those of regions; the result is smaller by the number of sweeps on each side.
    """
    before = regions
    for sweep in range(1, sweeps + 1):
        after = before.copy()
        nz, ny, nx = regions.shape
        for z in range(sweep, nz - sweep):
            for y in range(sweep, ny - sweep):
                for x in range(sweep, nx - sweep):
                    if fixed[z, y, x]:
                        continue
                    value, best = values[z, y, x], before[z, y, x]
                    error = abs(value - levels[best])
                    for other in (
                        before[z, y, x + 1],
                        before[z, y, x - 1],
                        before[z, y + 1, x],
                        before[z, y - 1, x],
                        before[z + 1, y, x],
                        before[z - 1, y, x],
                    ):
                        if other != best and abs(value - levels[other]) < error:
                            best, error = other, abs(value - levels[other])
                    after[z, y, x] = best
        before = after
    return before[sweeps:-sweeps, sweeps:-sweeps, sweeps:-sweeps]
