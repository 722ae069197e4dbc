"""Region adjacency graph of watershed basins, and the merging of those that are one grain (see `segment`)."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from skimage.segmentation import relabel_sequential

from grainmotion.kernels.basin_merging import merge_necks, merge_shallow
from grainmotion.segmentation.blocks import Work
from grainmotion.segmentation.label_pairs import LabelPairs

Ints = NDArray[np.int32]

MAX_SADDLE = 0.9
"""Saddle over the lower of the two peaks, above which basins are one: an uneven surface causes as much."""
NO_VALLEY, OPEN_VALLEY = 0.015, 0.03
"""Deficit of a neck, beyond its basins' own, up to which it is no valley, and from which it is an open one."""
MIN_FLATNESS = 0.7
"""Flatness, 1 for no valley and 0 for an open one, below which a shallow basin is not merged across it."""


@dataclass(frozen=True, eq=False)
class Deficits:
    """How much fainter basins and necks are than voxels as deep (see `valleys.deficits`).

    ``basins (n + 1,)`` are sums over the ``voxels (n + 1,)`` of each, ``necks (k,)`` over the faces of each pair.
    """

    basins: NDArray[np.float64]
    voxels: NDArray[np.float64]
    necks: NDArray[np.float64]
    noise: float


@dataclass(frozen=True, eq=False)
class BasinGraph:
    """Touching basins 1 … n: ``peaks (n + 1,)`` of the distance; each pair's saddle and faces along z, y, x.

    Distances are in voxels, faces in numbers of voxel faces.  ``deficits`` says how faint basins and necks are, if that
    is known.
    """

    peaks: NDArray[np.float64]
    pairs: NDArray[np.int64]  # (k, 2)
    saddles: NDArray[np.float64]  # (k,)
    faces: NDArray[np.float64]  # (k, 3)
    deficits: Deficits | None = None

    @classmethod
    def of(cls, distance: NDArray[np.float32], basins: Ints) -> BasinGraph:
        """The graph of basins of a distance transform."""
        peaks = np.zeros(int(basins.max()) + 1)
        peaks[1:] = ndimage.maximum(distance, basins, np.arange(1, len(peaks)))
        return cls.of_pairs(peaks, LabelPairs.of(basins, distance, len(peaks) - 1, Work()))

    @classmethod
    def of_pairs(cls, peaks: NDArray[np.float64], pairs: LabelPairs, deficits: Deficits | None = None) -> BasinGraph:
        """The graph of basins whose faces are known, with the lower distance at each."""
        saddles, faces = pairs.tops[:, 0].astype(float), pairs.faces.astype(float)
        return cls(peaks, pairs.pairs, saddles, faces, deficits)

    def _gathered(self) -> BasinGraph:
        """The same with each pair once, where pairs occur many times and in either order."""
        n, pairs = len(self.peaks), self.pairs
        key, index = np.unique(pairs.min(axis=1).astype(np.int64) * n + pairs.max(axis=1), return_inverse=True)
        highest, total = np.zeros(len(key)), np.zeros((len(key), 3))
        np.maximum.at(highest, index, self.saddles)
        np.add.at(total, index, self.faces)
        known = self.deficits
        if known is not None:
            known = replace(known, necks=_sums(index, known.necks, len(key)))
        return BasinGraph(self.peaks, np.column_stack([key // n, key % n]), highest, total, known)

    def merged(self, depth: float, oneness: float) -> Ints:
        """New labels ``(n + 1,)`` after both steps of merging."""
        shallow = self._merge_shallow(depth)
        return self._relabelled(shallow)._merge_necks(oneness)[shallow]

    def _merge_shallow(self, depth: float) -> Ints:
        """New labels after merging peaks that hardly rise above their highest saddle."""
        order = np.argsort(-self.saddles, kind="stable")
        order = order[self._flatness()[order] >= MIN_FLATNESS]
        return _numbered(merge_shallow(self.peaks, self.pairs, self.saddles, order, depth, MAX_SADDLE))

    def _relabelled(self, labels: Ints) -> BasinGraph:
        """The graph of basins merged under new labels."""
        peaks = np.zeros(int(labels.max()) + 1)
        np.maximum.at(peaks, labels, self.peaks)
        pairs = labels[self.pairs]
        apart = pairs[:, 0] != pairs[:, 1]
        known = self.deficits
        if known is not None:
            sums, voxels = (_sums(labels, values, len(peaks)) for values in (known.basins, known.voxels))
            known = Deficits(sums, voxels, known.necks[apart], known.noise)
        return BasinGraph(peaks, pairs[apart], self.saddles[apart], self.faces[apart], known)._gathered()

    def _flatness(self) -> NDArray[np.float64]:
        """Of each pair 1 if its neck is no valley, 0 if the valley is deep ``(k,)``."""
        known = self.deficits
        if known is None:
            return np.ones(len(self.pairs))
        means = known.basins / np.maximum(known.voxels, 1)
        counts = self.faces.sum(axis=1)
        return _flat(known.necks / counts - means[self.pairs].min(axis=1) - known.noise / np.sqrt(counts))

    def _merge_necks(self, oneness: float) -> Ints:
        """New labels after merging basins with a wide neck between them, the widest first."""
        count, pairs = len(self.peaks), len(self.pairs)
        known = self.deficits or Deficits(np.zeros(count), np.ones(count), np.zeros(pairs), 0.0)
        necks = self.saddles.copy(), self.faces.copy(), known.necks.copy()
        basins, valley = (known.basins.copy(), known.voxels.copy()), (NO_VALLEY, OPEN_VALLEY)
        return _numbered(merge_necks(self.peaks.copy(), self.pairs.copy(), necks, basins, oneness, known.noise, valley))


def _sums(index: NDArray[np.integer], values: NDArray[np.floating], count: int) -> NDArray[np.float64]:
    """Sums ``(count,)`` of the values of each index."""
    return np.asarray(np.bincount(index, values, minlength=count), dtype=float)


def _flat(deficit: NDArray[np.float64]) -> NDArray[np.float64]:
    """From 1 for no valley to 0 for an open one."""
    return np.asarray(np.clip((OPEN_VALLEY - deficit) / (OPEN_VALLEY - NO_VALLEY), 0, 1))


def _numbered(representatives: NDArray[np.int64]) -> Ints:
    """Labels ``(n + 1,)`` 0, 1 … of merged basins, in the order of the one that represents each."""
    return np.asarray(relabel_sequential(representatives)[0], np.int32)
