"""Grains of several materials, or in a liquid, separated level by level (see `phases`)."""

from __future__ import annotations

from dataclasses import dataclass

import edt
import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from grainmotion.segmentation.large_bodies import large_bodies
from grainmotion.segmentation.level_crossing import hosts_across_surface, with_caps
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
    def of(cls, array: Floats, levels: Levels, settings: SegmentSettings) -> Pieces:
        """Separate the solids of each level.

        Parameters
        ----------
        array : (nz, ny, nx) array
            Attenuation, 1/mm.
        levels : Levels
            Of the same volume.
        settings : SegmentSettings
            ``depth``, ``oneness`` and ``min_volume``.

        Returns
        -------
        Pieces
            Without films, and without pieces far smaller than the median grain.
        """
        labels, level_of = np.zeros(array.shape, np.int32), [0]
        around = levels.surrounding()
        for level in levels.solids:
            solid = levels.of_voxel == level
            # a grain may lie half in a liquid: the step differs from place to place
            step = np.where(solid, np.float32(levels.values[level]) - around, np.float32(1))
            excess = _excess(array, around, step, solid)
            if _noise(excess, solid) > MAX_NOISE:
                excess = _excess(ndimage.gaussian_filter(array, NOISE_SIGMA), around, step, solid)
            own = separated(excess, solid, 0.0, settings)
            own[own > 0] += len(level_of) - 1
            labels += own
            level_of += [level] * (int(labels.max()) + 1 - len(level_of))
        numbers = np.array(level_of, np.intp)
        if len(levels.solids) > 1:
            hosts = hosts_across_surface(labels, numbers, levels)
            like = _grain_like(array, labels, numbers, levels)
            labels = with_caps(np.where(like[hosts], hosts, 0).astype(np.int32)[labels], array, levels)
        labels, kept = large_enough(labels, settings)
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


def _excess(array: Floats, around: Floats, step: Floats, solid: Bools) -> Floats:
    """How far attenuation rises above what surrounds a grain, over the step to the grain's level; 0 outside."""
    return np.where(solid, (array - around) / step, 0).astype(np.float32)


def _noise(excess: Floats, solid: Bools) -> float:
    """Noise of the voxels inside grains over their excess, from the differences of neighbours."""
    inner = ndimage.binary_erosion(solid, iterations=2)
    pairs = inner[1:] & inner[:-1]
    if not pairs.any():
        return 0.0
    steps = np.abs(np.diff(excess, axis=0)[pairs])
    return float(1.05 * np.median(steps) / max(np.median(excess[inner]), 1e-30))  # of normal noise, 1.4826 / √2


def _grain_like(array: Floats, labels: Ints, level_of: NDArray[np.intp], levels: Levels) -> NDArray[np.bool_]:
    """Which labels ``(n + 1,)`` may be grains or bodies; others are films, or what the scan blurs between dense grains.

    The densest level has no such doubt.
    """
    count = len(level_of)
    ball = np.zeros(count)
    np.maximum.at(ball, labels.ravel(), edt.edt(labels, parallel=1).ravel())
    sizes = np.maximum(np.bincount(labels.ravel(), minlength=count), 1)
    mean = np.bincount(labels.ravel(), array.ravel(), minlength=count) / sizes
    densest = level_of == max(levels.solids)
    on_denser = _share_on_denser(labels, level_of, levels.of_voxel)
    like = (on_denser <= MAX_ON_DENSER) & (mean <= MAX_MEAN * levels.values[level_of]) & (ball >= MIN_BALL)
    like &= (sizes > SMALL * np.median(sizes[1:])) | (on_denser < MAX_SMALL_ON_DENSER)
    sure = like & (ball >= SURE_BALL)
    typical = float(np.median(ball[1:])) if count > 1 else 0.0
    for level in np.unique(level_of[1:]):
        own = level_of == level
        if not (sure[own].sum() >= MIN_SURE or (sure[own] & (ball[own] >= SURE_SHARE * typical)).any()):
            like[own] = False
    return np.asarray(like | densest)


def _share_on_denser(labels: Ints, level_of: NDArray[np.intp], of_voxel: NDArray[np.int8]) -> NDArray[np.float64]:
    """Share ``(n + 1,)`` of the surface of each label, towards other levels, that lies on denser ones."""
    on, all_faces = np.zeros(len(level_of)), np.zeros(len(level_of))
    for axis in range(3):
        own, near = np.moveaxis(labels, axis, 0), np.moveaxis(of_voxel, axis, 0)
        for inner, outer in ((slice(None, -1), slice(1, None)), (slice(1, None), slice(None, -1))):
            label, other = own[inner], near[outer]
            face = (label > 0) & (other != level_of[label])
            all_faces += np.bincount(label[face], minlength=len(level_of))
            face &= other > level_of[label]
            on += np.bincount(label[face], minlength=len(level_of))
    return np.asarray(on / np.maximum(all_faces, 1))
