"""Kernels: trilinear resampling of a volume on the grid of another, through an affine map of voxel indices.

Voxel (x, y, z) of the target lies at  q = A (x, y, z) + b  of the source (voxel centres at integers).
The source is zero outside its array, so that values fall to zero over one voxel beyond it.  Each thread takes
z planes of the target of its own: no two threads write the same voxel.
"""

from __future__ import annotations

import numba as nb
import numpy as np
from numpy.typing import NDArray

from grainmotion._typing import Float, Image, Index
from grainmotion.kernels.compilation import CACHE


@nb.njit(cache=CACHE, error_model="numpy")
def sample(source: Image, x: float, y: float, z: float) -> float:
    """Trilinear value of ``source (nz, ny, nx)`` at (x, y, z) in voxels, zero outside."""
    nz, ny, nx = source.shape
    if x <= -1 or y <= -1 or z <= -1 or x >= nx or y >= ny or z >= nz:
        return 0.0
    x0, y0, z0 = int(np.floor(x)), int(np.floor(y)), int(np.floor(z))
    wx, wy, wz = x - x0, y - y0, z - z0
    total = 0.0
    for k in range(2):
        iz = z0 + k
        if iz < 0 or iz >= nz:
            continue
        for j in range(2):
            iy = y0 + j
            if iy < 0 or iy >= ny:
                continue
            near = source[iz, iy, x0] if x0 >= 0 else 0.0
            far = source[iz, iy, x0 + 1] if x0 + 1 < nx else 0.0
            weight = (wz if k else 1 - wz) * (wy if j else 1 - wy)
            total += weight * ((1 - wx) * near + wx * far)
    return total


@nb.njit(parallel=True, cache=CACHE, error_model="numpy")
def add_moved(source: Image, matrix: Float, offset: Float, low: Index, high: Index, total: Image) -> None:
    """Add ``source`` sampled at A (x, y, z) + b to the voxels low … high − 1 (x y z) of ``total``."""
    for z in nb.prange(low[2], high[2]):
        for y in range(low[1], high[1]):
            for x in range(low[0], high[0]):
                qx = matrix[0, 0] * x + matrix[0, 1] * y + matrix[0, 2] * z + offset[0]
                qy = matrix[1, 0] * x + matrix[1, 1] * y + matrix[1, 2] * z + offset[1]
                qz = matrix[2, 0] * x + matrix[2, 1] * y + matrix[2, 2] * z + offset[2]
                total[z, y, x] += sample(source, qx, qy, qz)


@nb.njit(parallel=True, cache=CACHE, error_model="numpy")
def add_moved_label(
    source: Image,
    matrix: Float,
    offset: Float,
    low: Index,
    high: Index,
    total: Image,
    label: np.int32,
    threshold: np.float32,
    best: Image,
    labels: NDArray[np.int32],
) -> None:
    """`add_moved`; where the sample exceeds ``threshold`` and ``best``, also write ``label`` and ``best``."""
    for z in nb.prange(low[2], high[2]):
        for y in range(low[1], high[1]):
            for x in range(low[0], high[0]):
                qx = matrix[0, 0] * x + matrix[0, 1] * y + matrix[0, 2] * z + offset[0]
                qy = matrix[1, 0] * x + matrix[1, 1] * y + matrix[1, 2] * z + offset[1]
                qz = matrix[2, 0] * x + matrix[2, 1] * y + matrix[2, 2] * z + offset[2]
                value = sample(source, qx, qy, qz)
                total[z, y, x] += value
                if value > threshold and value > best[z, y, x]:
                    best[z, y, x] = value
                    labels[z, y, x] = label
