"""Voxels fainter than others as deep inside their grain: the valley that blur leaves where two grains touch.

Blur closes the gap between two faces that lie close to each other, so that cores join there and the neck is as wide as
the faces.  Some of the gap is still seen: attenuation rises more slowly with depth than below a free surface.

Where a cone beam blurs layers of grains along its axis (`blurred_gaps`), all grains of a layer are fainter half-way up
than above and below, by up to 6 %.  That is no valley, so there deficits are taken over the mean of the same height.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from grainmotion.kernels.block_filters import sum_block
from grainmotion.segmentation.blocks import Block, Work, blocks_of
from grainmotion.segmentation.percentiles import FineBins

Floats = NDArray[np.float32]

DEPTH_BIN = 0.5
"""Width of the bins of depth, voxels."""
MAX_DEPTH = 8.0
"""Depth from which attenuation does not depend on it, voxels."""
MAX_LEVEL = 1.05
"""Attenuation over the grain's own, from which a voxel is of an inclusion and counts as this much."""
NOISE_DEPTH = 2.0
"""Depth from which noise is measured, voxels."""
NOISE_WINDOW = 3
"""Edge of the cubes over which deficits are averaged to measure it, voxels."""
NOISE_BINS = 1 << 17
"""Bins of the histogram of these means, from -1 to 1."""
CELL = 64
"""Edge of the squares of a layer of voxels in which its mean deficit is measured, each with its eight neighbours,
voxels; blocks consist of whole ones."""
MIN_AT_HEIGHT = 5000
"""Deep voxels of such a part of a layer, about those of 20 grains, from which its mean is that of the layer."""


@dataclass(frozen=True, eq=False)
class Valleys:
    """How much fainter voxels are than the median of those as deep.

    Attributes
    ----------
    level : callable
        Attenuation over the grain's own nearby, of a block and of some voxels around it: ``level(block, reach)``.
    distance : (nz, ny, nx) array
        Depth inside the cores of the grains, voxels; 0 outside.
    typical : (bins,) array
        Median level of the voxels of each bin of depth.
    at_height : (nz, cells along y, cells along x) array, optional
        Mean deficit of the deep voxels of a layer, around each cell; where it is None it counts as 0.
    """

    level: Callable[[Block, int], Floats]
    distance: Floats
    typical: Floats
    at_height: Floats | None = None

    @classmethod
    def of(cls, level: Callable[[Block, int], Floats], distance: Floats, work: Work, blurred: bool = False) -> Valleys:
        """Measure what is typical of each depth, and in a sample with blurred layers of each height."""
        bins, most = FineBins.up_to(MAX_LEVEL), int(MAX_DEPTH / DEPTH_BIN) + 1

        def count(block: Block, counts: NDArray[np.int64]) -> NDArray[np.int64]:
            depth = distance[block.box]
            if depth.any():
                bins.add(np.minimum(level(block, 0), np.float32(MAX_LEVEL)), _bins(depth), counts)
            return counts

        counts = np.asarray(sum(work.gathered(blocks_of(distance.shape), lambda: bins.empty(most), count)))
        valleys = cls(level, distance, np.array([bins.quantile(row, 0.5) for row in counts], np.float32))
        return replace(valleys, at_height=valleys._means_of_layers(work)) if blurred else valleys

    def _means_of_layers(self, work: Work) -> Floats:
        """Mean deficits of deep voxels around each cell of each layer, 0 where there are few."""
        nz, ny, nx = self.distance.shape
        sums, voxels = np.zeros((2, nz, -(-ny // CELL), -(-nx // CELL)))

        def add(block: Block) -> None:
            deep = self.distance[block.box] > NOISE_DEPTH
            if deep.any():
                z, y, x = block.box
                cells = z, y.start // CELL, slice(x.start // CELL, -(-x.stop // CELL))
                starts = np.arange(0, x.stop - x.start, CELL)
                deficits = np.where(deep, self.deficits(block)[1:-1, 1:-1, 1:-1], np.float32(0))
                sums[cells] = np.add.reduceat(deficits.sum(axis=1, dtype=float), starts, axis=1)
                voxels[cells] = np.add.reduceat(deep.sum(axis=1), starts, axis=1)

        work.each(blocks_of(self.distance.shape), add)
        around = [ndimage.uniform_filter(values, (1, 3, 3), mode="constant") for values in (sums, voxels)]
        enough = 9 * around[1] > MIN_AT_HEIGHT
        return np.divide(around[0], around[1], out=np.zeros_like(sums), where=enough).astype(np.float32)

    def deficits(self, block: Block) -> Floats:
        """Deficits of a block and of one voxel more on each side, as a share of the grain's own attenuation.

        They are 0 outside of the cores.
        """
        depth = block.gather(self.distance, 1, 0)
        if not depth.any():
            return depth
        level = np.minimum(self.level(block, 1), np.float32(MAX_LEVEL))
        typical = self.typical[_bins(depth)]
        if self.at_height is not None:
            z, y, x = (
                np.clip(np.arange(a - 1, b + 1), 0, n - 1)
                for a, b, n in zip(block.start, block.stop, self.distance.shape, strict=True)
            )
            typical -= self.at_height[np.ix_(z, y // CELL, x // CELL)]
        return np.where(depth > 0, typical - level, np.float32(0))

    def noise_of(self, counts: NDArray[np.int64]) -> float:
        """Standard deviation of the mean deficit over a neck of n faces, times the root of n, from `noise_counts`.

        It is taken from means over cubes as wide as a neck of nine faces, since noise is correlated between voxels.
        """
        total, edges = np.cumsum(counts), np.linspace(-1, 1, NOISE_BINS + 1)
        if total[-1] == 0:
            return 0.0
        middle = (edges[:-1] + edges[1:]) / 2
        away = np.abs(middle - middle[np.searchsorted(total, (total[-1] + 1) // 2)])
        order = np.argsort(away, kind="stable")
        spread = away[order][np.searchsorted(np.cumsum(counts[order]), (total[-1] + 1) // 2)]
        return NOISE_WINDOW * 1.4826 * float(spread)

    def noise_counts(self, block: Block, deficits: Floats) -> NDArray[np.int64]:
        """How often mean deficits ``(NOISE_BINS,)`` occur around the voxels of a block that are deep enough."""
        deep = self.distance[block.box] > NOISE_DEPTH
        if not deep.any():
            return np.zeros(NOISE_BINS, np.int64)
        means = sum_block(deficits, NOISE_WINDOW)[deep] / np.float32(NOISE_WINDOW**3)
        places = ((means + 1) * np.float32(NOISE_BINS / 2)).astype(np.int64)
        return np.bincount(np.clip(places, 0, NOISE_BINS - 1), minlength=NOISE_BINS)


def _bins(depth: Floats) -> NDArray[np.int8]:
    """The bin of each depth, -1 outside of the cores."""
    bins = (np.minimum(depth, np.float32(MAX_DEPTH)) / np.float32(DEPTH_BIN)).astype(np.int8)
    return np.where(depth > 0, bins, np.int8(-1))
