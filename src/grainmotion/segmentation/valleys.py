"""Voxels fainter than others as deep inside their grain: the valley that blur leaves where two grains touch.

Blur closes the gap between two faces that lie close to each other, so that cores join there and the neck is as wide as
the faces.  Some of the gap is still seen: attenuation rises more slowly with depth than below a free surface.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

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
    """

    level: Callable[[Block, int], Floats]
    distance: Floats
    typical: Floats

    @classmethod
    def of(cls, level: Callable[[Block, int], Floats], distance: Floats, work: Work) -> Valleys:
        """Measure what is typical of each depth."""
        bins, most = FineBins.up_to(MAX_LEVEL), int(MAX_DEPTH / DEPTH_BIN) + 1

        def count(block: Block, counts: NDArray[np.int64]) -> NDArray[np.int64]:
            depth = distance[block.box]
            if depth.any():
                bins.add(np.minimum(level(block, 0), np.float32(MAX_LEVEL)), _bins(depth), counts)
            return counts

        counts = np.asarray(sum(work.gathered(blocks_of(distance.shape), lambda: bins.empty(most), count)))
        return cls(level, distance, np.array([bins.quantile(row, 0.5) for row in counts], np.float32))

    def deficits(self, block: Block) -> Floats:
        """Deficits of a block and of one voxel more on each side, as a share of the grain's own attenuation.

        They are 0 outside of the cores.
        """
        depth = block.gather(self.distance, 1, 0)
        if not depth.any():
            return depth
        level = np.minimum(self.level(block, 1), np.float32(MAX_LEVEL))
        return np.where(depth > 0, self.typical[_bins(depth)] - level, np.float32(0))

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
