"""Attenuation of grains over their own, nearby: 0 is the mean outside the grains, 1 the grain's own."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from grainmotion.kernels.block_filters import erode_block, sum_block
from grainmotion.model.large_arrays import large_zeros
from grainmotion.segmentation.blocks import Block, Box, Work, blocks_of
from grainmotion.segmentation.components import Components, fill_holes
from grainmotion.segmentation.heights import Heights
from grainmotion.segmentation.percentiles import median

Floats = NDArray[np.float32]
Bools = NDArray[np.bool_]

CORE_LEVEL = 0.75
"""Level of the cores: 0 is the mean outside the grains, 1 the grain's own attenuation nearby."""
CORE_WINDOW = 9
"""Edge of the cube over which a grain's own attenuation is averaged, voxels."""


@dataclass(frozen=True, eq=False)
class OwnLevel:
    """Attenuation of each voxel of a volume over that of its grain.

    A grain fainter than the others has a lower one of its own; inclusions brighter than the others do not raise it.

    Attributes
    ----------
    heights : Heights
        Attenuation, 1/mm.
    solid : (nz, ny, nx) bool array
        Voxels of the grains.
    bright, dark : float
        Median of the grains and mean outside of them, 1/mm.
    """

    heights: Heights
    solid: Bools
    bright: float
    dark: float

    @classmethod
    def of(cls, heights: Heights, solid: Bools, box: Box, work: Work) -> OwnLevel:
        """The levels of a volume whose grains lie in a box."""
        array = heights.whole(work)
        bright = median(work, array, solid.view(np.uint8))

        def add(block: Block) -> tuple[float, int]:
            outside = ~solid[block.box]
            values = array[block.box]
            return float(values.sum(where=outside, dtype=float)), int(np.count_nonzero(outside))

        # every plane is added up by itself, whatever the blocks
        planes = [Block((z, box[1].start, box[2].start), (z + 1, box[1].stop, box[2].stop)) for z in _planes(box)]
        sums = np.array(work.each(planes, add))
        return cls(heights, solid, bright, float(sums[:, 0].sum() / max(sums[:, 1].sum(), 1)))

    def at(self, block: Block, reach: int = 0) -> Floats:
        """Levels of a block and of some voxels around it; beyond the volume those of nothing."""
        half = CORE_WINDOW // 2
        bright, dark = np.float32(self.bright), np.float32(self.dark)
        inner = erode_block(block.gather(self.solid, reach + half + 1, 0, np.uint8)).astype(np.float32)
        values = self.heights.gather(block, reach + half)
        middle = tuple(slice(half, n - half) for n in values.shape)
        level = values[middle] - dark
        weight = sum_block(inner, CORE_WINDOW)
        np.minimum(values, bright, out=values)
        values *= inner
        own = sum_block(values, CORE_WINDOW)
        averaged = weight > 1
        np.divide(own, weight, out=own, where=averaged)
        own[~averaged] = bright
        own -= dark
        np.divide(level, own, out=level, where=own > 0)
        return level

    def cores(self, threshold: float, box: Box, work: Work) -> Bools:
        """Voxels above `CORE_LEVEL` and above a threshold, with what they enclose; all of a piece without any."""
        found = large_zeros(self.solid.shape, bool)

        def fill(block: Block) -> None:
            solid = self.solid[block.box]
            if solid.any():
                found[block.box] = solid & (self.heights.gather(block, 0) > threshold) & (self.at(block) > CORE_LEVEL)

        work.each(blocks_of(found.shape, box), fill)
        fill_holes(found, work)
        pieces = Components.of(self.solid, work)
        coreless = ~pieces.holding(found)  # too thin or too faint for a core
        pieces.paint(found.view(np.uint8), coreless.astype(np.uint8), work)
        return found


def _planes(box: Box) -> range:
    return range(box[0].start, box[0].stop)
