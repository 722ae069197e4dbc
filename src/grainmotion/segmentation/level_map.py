"""Each voxel's level of attenuation: cores flood what lies between them, borders lie half-way.

The partial volumes between a dense grain and air have the attenuation of a faint grain or a liquid, but not its place:
a flood from the cores of both, steep places last, meets in the middle of the surface.  Then each voxel at a border
takes the level of its own or its neighbours' that is nearest to its attenuation, which is the half-way level.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from skimage.segmentation import watershed

from grainmotion.segmentation.uniform_cores import Floats, Ints, UniformCores

BORDER_SWEEPS = 3
"""Voxels by which a border moves at most from where the floods meet."""
BLUR_SHELL = 2
"""Voxels around a dense body within which its blur looks like a faint one."""


def flooded(array: Floats, cores: UniformCores) -> Ints:
    """The core whose body each voxel belongs to.

    Parameters
    ----------
    array : (nz, ny, nx) array
        Attenuation, 1/mm.
    cores : UniformCores
        Cores of the same volume.

    Returns
    -------
    (nz, ny, nx) int32 array
        Numbers of cores, 1 … n.
    """
    inside = cores.labels > 0
    rim = inside & ~ndimage.binary_erosion(inside, border_value=1)
    steep = ndimage.maximum_filter(cores.smooth, 3)
    steep -= ndimage.minimum_filter(cores.smooth, 3)
    front = watershed(steep, np.where(rim, cores.labels, 0), mask=rim | ~inside)
    regions = np.where(inside, cores.labels, front).astype(np.int32)
    return _half_way(array, regions, cores)


def _half_way(array: Floats, regions: Ints, cores: UniformCores) -> Ints:
    """Borders between regions of different levels moved to the half-way level."""
    padded = np.pad(regions, 1, mode="edge")
    flat = padded.reshape(-1)
    level = np.concatenate([cores.levels[cores.level_of]])
    free = np.flatnonzero(np.pad(cores.labels == 0, 1))
    values = np.pad(array, 1).reshape(-1)[free]
    _, ny, nx = padded.shape
    steps = np.array([1, -1, nx, -nx, ny * nx, -ny * nx])
    for _ in range(BORDER_SWEEPS):
        best, before = flat[free], flat.copy()
        error = np.abs(values - level[best])
        for step in steps:
            other = before[free + step]
            theirs = np.abs(values - level[other])
            nearer = theirs < error
            best, error = np.where(nearer, other, best), np.where(nearer, theirs, error)
        if (best == before[free]).all():
            break
        flat[free] = best
    return padded[1:-1, 1:-1, 1:-1]


def without_shells(array: Floats, of_voxel: NDArray[np.int8], levels: NDArray[np.float64]) -> NDArray[np.int8]:
    """Levels whose faint voxels near the surface of a denser level are those of what lies beyond.

    Within `BLUR_SHELL` voxels of a dense body blur alone gives any lower attenuation, so there only the place counts:
    the border between a faint grain and air goes on straight to the dense surface.

    Parameters
    ----------
    array : (nz, ny, nx) array
        Attenuation, 1/mm.
    of_voxel : (nz, ny, nx) int8 array
        Number of each voxel's level.
    levels : (k,) array
        Attenuation of the levels, rising, 1/mm.

    Returns
    -------
    (nz, ny, nx) int8 array
        The corrected numbers.
    """
    result = of_voxel.copy()
    for dense in range(len(levels) - 1, 1, -1):
        body = result >= dense
        near = ndimage.binary_dilation(body, iterations=BLUR_SHELL)
        if near.all() or not body.any():
            continue
        z, y, x = np.nonzero(near & ~body)
        nearest = ndimage.distance_transform_edt(near, return_distances=False, return_indices=True)[:, z, y, x]
        beyond = result[tuple(nearest)]
        beyond = np.where(beyond >= dense, result[z, y, x], beyond)
        low = (levels[beyond] + levels[0]) / 2
        result[z, y, x] = np.where((beyond > 0) & (array[z, y, x] < low), 0, beyond)
    return result
