"""Grains of several materials, or in a liquid, separated level by level (see `phases`)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from grainmotion.kernels.block_filters import erode_block, smooth_block
from grainmotion.model.large_arrays import large_zeros
from grainmotion.segmentation.blocks import Block, Work, blocks_of
from grainmotion.segmentation.distance_basins import largest_balls
from grainmotion.segmentation.heights import Heights
from grainmotion.segmentation.label_measures import (
    faces_on_codes,
    highest_label,
    label_sizes,
    label_sums,
    put_aside,
    renumber,
    take_back,
)
from grainmotion.segmentation.large_bodies import large_bodies
from grainmotion.segmentation.level_codes import gaussian_weights
from grainmotion.segmentation.level_crossing import grow_caps, hosts_across_surface
from grainmotion.segmentation.percentiles import FineBins
from grainmotion.segmentation.phases import Levels
from grainmotion.segmentation.separation import large_enough, separated
from grainmotion.segmentation.settings import SegmentSettings
from grainmotion.segmentation.uniform_cores import Bools, Floats, Ints

MAX_ON_DENSER = 0.5
"""Share of a grain's surface that lies on denser bodies; more has a film, a meniscus or what the scan blurs in gaps."""
SMALL = 0.05
"""Volume of a small piece over the median one, of which less may lie on denser bodies."""
MAX_SMALL_ON_DENSER = 0.2
"""Share of its surface that does."""
MAX_NOISE = 0.12
"""Noise of a voxel over the excess of a grain, above which grains are separated in the filtered volume."""
NOISE_SIGMA = 0.7
"""Width of that filter, a Gaussian, voxels."""
HIGHEST_EXCESS = 100.0
"""Largest excess that is told apart where noise is measured."""
MAX_MEAN = 1.35
"""Mean attenuation of a grain over its level; 0.8 to 1.1 in grains, 1.2 to 3 in what is blurred between denser ones."""
MIN_BALL = 1.5
"""Radius of the largest ball in a grain fainter than others, voxels."""
SURE_BALL = 2.5
"""The same in a grain that shows that its level is one of grains."""
MIN_SURE = 3
"""Such grains that do."""
SURE_SHARE = 0.4
"""Radius of the largest ball of one grain that alone does, over the median one."""
MAX_RATIO = 2.0
"""Ratio of two materials up to which one threshold gives the surfaces of both."""
MIN_OVER_THRESHOLD = 1.3
"""Attenuation of the faintest grains over a threshold that does not cut through them."""


@dataclass(frozen=True, eq=False)
class Pieces:
    """Labels 1 … n of the solids, pieces of bodies among them, and the level of each (entry 0 is not used)."""

    labels: Ints
    level_of: NDArray[np.intp]

    @classmethod
    def of(cls, array: Floats, levels: Levels, settings: SegmentSettings, work: Work) -> Pieces:
        """Separate the solids of each level.

        Parameters
        ----------
        array : (nz, ny, nx) array
            Attenuation, 1/mm.
        levels : Levels
            Of the same volume.
        settings : SegmentSettings
            ``depth``, ``oneness`` and ``min_volume``.
        work : Work
            Threads.

        Returns
        -------
        Pieces
            Without films, and without pieces far smaller than the median grain.
        """
        labels, level_of = large_zeros(array.shape, np.int32), [0]
        around = levels.around(work)
        for level in levels.solids:
            solid = levels.of_voxel == level
            excess = _excess(array, levels, around, level, 0.0)
            if _noise(excess, solid, work) > MAX_NOISE:
                excess = _excess(array, levels, around, level, NOISE_SIGMA)
            count = highest_label(separated(excess, solid, 0.0, settings, work, labels), work)
            del solid
            put_aside(labels, len(level_of) - 1, work)
            level_of += [level] * count
        del around
        take_back(labels, work)
        numbers = np.array(level_of, np.intp)
        if len(levels.solids) > 1:
            hosts = hosts_across_surface(labels, numbers, levels, work)
            like = _grain_like(array, labels, numbers, levels, work)
            renumber(labels, np.where(like[hosts], hosts, 0), work)
            grow_caps(labels, array, levels, work)
        kept = large_enough(labels, settings, work)
        return cls(labels, numbers[kept])

    def fit_one_threshold(self, levels: Levels, threshold: float) -> bool:
        """Whether a threshold alone separates the grains from all else, and near their surfaces.

        Parameters
        ----------
        levels : Levels
            Of the same volume.
        threshold : float
            1/mm.

        Returns
        -------
        bool
            True in a sample of one material, though a wall or inclusions may have other levels.
        """
        bodies = large_bodies(self.labels)
        body = np.isin(np.arange(len(self.level_of)), bodies)
        grains, others = self.level_of[1:][~body[1:]], self.level_of[1:][body[1:]]
        if levels.has_liquid or len(grains) == 0:
            return False
        low, high = levels.values[grains.min()], levels.values[grains.max()]
        outside = [k for k in others if levels.values[k] > threshold and k not in grains]
        return bool(high <= MAX_RATIO * low and low >= MIN_OVER_THRESHOLD * threshold and not outside)


def _excess(array: Floats, levels: Levels, around: NDArray[np.int8], level: int, sigma: float) -> Heights:
    """How far attenuation rises above what surrounds a grain, over the step to the grain's level; 0 outside.

    A grain may lie half in a liquid: the step differs from place to place.
    """
    values, weights = levels.values.astype(np.float32), gaussian_weights(sigma) if sigma else np.ones(1)

    def gather(block: Block, reach: int) -> NDArray[np.float32]:
        solid = block.gather(levels.of_voxel, reach, -1, np.int8) == level
        if not solid.any():
            return np.zeros(solid.shape, np.float32)
        low = values[block.gather(around, reach, 0, np.int8)]
        smooth = smooth_block(block.gather(array, reach + len(weights) - 1), weights)
        return np.where(solid, (smooth - low) / np.where(solid, values[level] - low, np.float32(1)), np.float32(0))

    return Heights(array.shape, gather, blurred=levels.blurred)


def _noise(excess: Heights, solid: Bools, work: Work) -> float:
    """Noise of the voxels inside grains over their excess, from the differences of neighbours."""
    bins = FineBins.up_to(HIGHEST_EXCESS)

    def count(block: Block, counts: NDArray[np.int64]) -> NDArray[np.int64]:
        if solid[block.box].any():
            inner = erode_block(erode_block(block.gather(solid, 3, 0, np.uint8))) > 0  # a voxel more on each side
            values = excess.gather(block, 1)
            here = inner[1:-1, 1:-1, 1:-1]
            bins.add(values[1:-1, 1:-1, 1:-1], here.view(np.int8) - np.int8(1), counts[:1])
            pairs = here & inner[2:, 1:-1, 1:-1]
            bins.add(np.abs(np.diff(values, axis=0)[1:, 1:-1, 1:-1]), pairs.view(np.int8) - np.int8(1), counts[1:])
        return counts

    counts = np.asarray(sum(work.gathered(blocks_of(excess.shape), lambda: bins.empty(2), count)))
    if not counts[1].any():
        return 0.0
    middle, step = (bins.quantile(row, 0.5) for row in counts)
    return 1.05 * step / max(middle, 1e-30)  # of normal noise, 1.4826 / √2


def _grain_like(
    array: Floats, labels: Ints, level_of: NDArray[np.intp], levels: Levels, work: Work
) -> NDArray[np.bool_]:
    """Which labels ``(n + 1,)`` may be grains or bodies; others are films, or what the scan blurs between dense grains.

    The densest level has no such doubt.
    """
    count = len(level_of)
    ball = largest_balls(labels, count - 1, work)
    sizes = np.maximum(label_sizes(labels, count - 1, work), 1)
    mean = label_sums(labels, array, count - 1, work) / sizes
    densest = level_of == max(levels.solids)
    faces = faces_on_codes(labels, levels.of_voxel, count - 1, work)
    codes = np.arange(faces.shape[1])
    elsewhere = np.where(codes != level_of[:, None], faces, 0)  # towards other levels
    on_denser = np.where(codes > level_of[:, None], faces, 0).sum(axis=1) / np.maximum(elsewhere.sum(axis=1), 1)
    like = (on_denser <= MAX_ON_DENSER) & (mean <= MAX_MEAN * levels.values[level_of]) & (ball >= MIN_BALL)
    like &= (sizes > SMALL * np.median(sizes[1:])) | (on_denser < MAX_SMALL_ON_DENSER)
    sure = like & (ball >= SURE_BALL)
    typical = float(np.median(ball[1:])) if count > 1 else 0.0
    for level in np.unique(level_of[1:]):
        own = level_of == level
        if not (sure[own].sum() >= MIN_SURE or (sure[own] & (ball[own] >= SURE_SHARE * typical)).any()):
            like[own] = False
    return np.asarray(like | densest)
