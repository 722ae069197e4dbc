"""Region adjacency graph of watershed basins, and the merging of those that are one grain (see `segment`)."""

from __future__ import annotations

import heapq
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.cluster.hierarchy import DisjointSet
from skimage.segmentation import relabel_sequential

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
        count, level = len(self.peaks), self._flatness()
        sets, highest = DisjointSet(range(count)), np.arange(count)  # of each set's root, the basin of its highest peak
        for k in np.argsort(-self.saddles, kind="stable"):
            if level[k] < MIN_FLATNESS:
                continue
            a, b = (int(highest[sets[int(i)]]) for i in self.pairs[k])
            low, high = (a, b) if self.peaks[a] < self.peaks[b] else (b, a)
            peak, saddle = self.peaks[low], self.saddles[k]
            if a != b and (peak - saddle < depth or saddle > MAX_SADDLE * peak):
                sets.merge(a, b)
                highest[sets[a]] = high
        return _numbered(highest, sets)

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
        count, peaks = len(self.peaks), self.peaks.copy()
        sets, first = DisjointSet(range(count)), np.arange(count)  # of each set's root, its first basin
        known = self.deficits or Deficits(np.zeros(count), np.ones(count), np.zeros(len(self.pairs)), 0.0)
        basins, voxels = known.basins.copy(), known.voxels.copy()
        necks: list[dict[int, tuple[float, NDArray[np.float64], float]]] = [{} for _ in peaks]
        values = zip(self.pairs.tolist(), self.saddles.tolist(), self.faces, known.necks.tolist(), strict=True)
        for (a, b), saddle, faces, faint in values:
            necks[a][b] = necks[b][a] = (saddle, faces, faint)
        version = [0] * count
        queue: list[tuple[float, int, int, int, int]] = []

        def offer(a: int, b: int) -> None:
            (saddle, faces, faint), peak = necks[a][b], min(peaks[a], peaks[b])
            # the norm of the numbers of faces is the area of a flat neck of any orientation
            kappa = saddle**2 * float(np.sqrt(faces @ faces)) / (np.pi * peak**4)
            if kappa >= oneness and self.deficits is not None:
                total, around = faces.sum(), min(basins[a] / voxels[a], basins[b] / voxels[b])
                kappa *= float(_flat(faint / total - around - known.noise / np.sqrt(total)))
            if kappa >= oneness:
                heapq.heappush(queue, (-kappa, a, b, version[a], version[b]))

        for a, b in self.pairs.tolist():
            offer(a, b)
        while queue:
            _, a, b, va, vb = heapq.heappop(queue)
            if version[a] != va or version[b] != vb:
                continue
            sets.merge(a, b)
            first[sets[a]] = a
            peaks[a] = max(peaks[a], peaks[b])
            basins[a], voxels[a] = basins[a] + basins[b], voxels[a] + voxels[b]
            version[a], version[b] = version[a] + 1, -1
            for c, (saddle, faces, faint) in necks[b].items():
                del necks[c][b]
                if c != a:
                    old, before, fainter = necks[a].get(c, (0.0, 0.0, 0.0))
                    necks[a][c] = necks[c][a] = (max(saddle, old), faces + before, faint + fainter)
            necks[b] = {}
            for c in necks[a]:
                offer(min(a, c), max(a, c))
        return _numbered(first, sets)


def _sums(index: NDArray[np.integer], values: NDArray[np.floating], count: int) -> NDArray[np.float64]:
    """Sums ``(count,)`` of the values of each index."""
    return np.asarray(np.bincount(index, values, minlength=count), dtype=float)


def _flat(deficit: NDArray[np.float64]) -> NDArray[np.float64]:
    """From 1 for no valley to 0 for an open one."""
    return np.asarray(np.clip((OPEN_VALLEY - deficit) / (OPEN_VALLEY - NO_VALLEY), 0, 1))


def _numbered(representatives: NDArray[np.int64], sets: DisjointSet) -> Ints:
    """Labels ``(n + 1,)`` 0, 1 … of the sets, in the order of the basin that represents each (given for its root)."""
    basins = representatives[[sets[i] for i in range(len(representatives))]]
    return np.asarray(relabel_sequential(basins)[0], np.int32)
