"""Each voxel's level of attenuation: cores flood what lies between them, borders lie half-way.

The partial volumes between a dense grain and air have the attenuation of a faint grain or a liquid, but not its place:
a flood from the cores of both, steep places last, meets in the middle of the surface.  Then each voxel at a border
takes the level of its own or its neighbours' that is nearest to its attenuation, which is the half-way level.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from grainmotion.kernels.block_filters import half_way_block, range_block, smooth_block
from grainmotion.model.large_arrays import large_empty, large_zeros
from grainmotion.segmentation.blocks import Block, Work, blocks_of
from grainmotion.segmentation.distance_basins import nearest_codes
from grainmotion.segmentation.flooding import grow_labels
from grainmotion.segmentation.level_codes import SMOOTHING, gaussian_weights
from grainmotion.segmentation.uniform_cores import Floats, Ints, UniformCores

BORDER_SWEEPS = 3
"""Voxels by which a border moves at most from where the floods meet."""
BLUR_SHELL = 2
"""Voxels around a dense body within which its blur looks like a faint one."""


def flooded(array: Floats, cores: UniformCores, work: Work) -> Ints:
    """The core whose body each voxel belongs to.

    Parameters
    ----------
    array : (nz, ny, nx) array
        Attenuation, 1/mm.
    cores : UniformCores
        Cores of the same volume.
    work : Work
        Threads.

    Returns
    -------
    (nz, ny, nx) int32 array
        Numbers of cores, 1 … n.
    """
    shape, weights = array.shape, gaussian_weights(SMOOTHING)
    heights, count = large_empty(shape, np.float32), len(cores.level_of) - 1

    def fill(block: Block) -> None:  # steep places are low
        heights[block.box] = -range_block(smooth_block(block.gather(array, len(weights)), weights))

    work.each(blocks_of(shape), fill)
    regions, fixed = large_empty(shape, np.int32), large_zeros(shape, np.uint8)
    regions[...] = -1
    cores.components.paint(regions, cores.numbers, work)
    cores.components.paint(fixed, (cores.numbers > 0).astype(np.uint8), work)
    grow_labels(regions, heights, count, work)
    out, levels = heights.view(np.int32), cores.levels[cores.level_of].astype(np.float32)  # the same memory
    reach = BORDER_SWEEPS

    def move(block: Block) -> None:
        own, free = block.gather(regions, reach, None, np.int32), block.gather(fixed, reach, None, np.uint8)
        out[block.box] = half_way_block(own, block.gather(array, reach), free, levels, reach)

    work.each(blocks_of(shape), move)
    return out


def without_shells(
    array: Floats, of_voxel: NDArray[np.int8], levels: NDArray[np.float64], work: Work
) -> NDArray[np.int8]:
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
    work : Work
        Threads.

    Returns
    -------
    (nz, ny, nx) int8 array
        The corrected numbers.
    """
    result, shape = of_voxel.copy(), of_voxel.shape
    for dense in range(len(levels) - 1, 1, -1):
        far = large_empty(shape, bool)

        def mark(block: Block, dense: int = dense, far: NDArray[np.bool_] = far) -> bool:
            body = block.gather(result, BLUR_SHELL, -1, np.int8) >= dense
            near = ndimage.binary_dilation(body, iterations=BLUR_SHELL) if body.any() else body
            far[block.box] = ~near[(slice(BLUR_SHELL, -BLUR_SHELL),) * 3]
            return bool(body.any())

        if not any(work.each(blocks_of(shape), mark)) or not far.any():
            continue
        nearest = nearest_codes(result, far, work)

        def correct(block: Block, dense: int = dense, nearest: NDArray[np.int8] = nearest, far: NDArray = far) -> None:
            own, beyond = result[block.box], nearest[block.box]
            shell = ~far[block.box] & (own < dense)
            beyond = np.where(beyond >= dense, own, beyond)
            low = ((levels[beyond] + levels[0]) / 2).astype(np.float32)
            own[shell] = np.where((beyond > 0) & (array[block.box] < low), 0, beyond)[shell]

        work.each(blocks_of(shape), correct)
    return result
