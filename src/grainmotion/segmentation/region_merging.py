"""Region adjacency graph of watershed basins, and the merging of those that are one grain (see `segment`)."""

from __future__ import annotations

import heapq
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.cluster.hierarchy import DisjointSet
from skimage.segmentation import relabel_sequential

Ints = NDArray[np.int32]

MAX_SADDLE = 0.9
"""Saddle over the lower of the two peaks, above which basins are one: an uneven surface causes as much."""


@dataclass(frozen=True, eq=False)
class BasinGraph:
    """Touching basins 1 … n: ``peaks (n + 1,)`` of the distance; each pair's saddle and faces along z, y, x.

    Distances are in voxels, faces in numbers of voxel faces.
    """

    peaks: NDArray[np.float64]
    pairs: NDArray[np.int64]  # (k, 2)
    saddles: NDArray[np.float64]  # (k,)
    faces: NDArray[np.float64]  # (k, 3)

    @classmethod
    def of(cls, distance: NDArray[np.float32], basins: Ints) -> BasinGraph:
        """The graph of basins of a distance transform."""
        peaks = np.zeros(int(basins.max()) + 1)
        peaks[1:] = ndimage.maximum(distance, basins, np.arange(1, len(peaks)))
        pairs, heights = [], []
        for axis in range(3):
            first = tuple(slice(None, -1) if k == axis else slice(None) for k in range(3))
            second = tuple(slice(1, None) if k == axis else slice(None) for k in range(3))
            a, b = basins[first], basins[second]
            meet = (a != b) & (a > 0) & (b > 0)
            pairs.append(np.column_stack([a[meet], b[meet]]))
            heights.append(np.minimum(distance[first][meet], distance[second][meet]))
        axes = np.repeat([0, 1, 2], [len(p) for p in pairs])
        return cls._gathered(peaks, np.concatenate(pairs), np.concatenate(heights), np.eye(3)[axes])

    @classmethod
    def _gathered(
        cls, peaks: NDArray[np.float64], pairs: NDArray[np.integer], saddles: NDArray[np.floating], faces: NDArray
    ) -> BasinGraph:
        """From pairs that may occur many times and in either order."""
        n = len(peaks)
        key, index = np.unique(pairs.min(axis=1).astype(np.int64) * n + pairs.max(axis=1), return_inverse=True)
        highest, total = np.zeros(len(key)), np.zeros((len(key), 3))
        np.maximum.at(highest, index, saddles)
        np.add.at(total, index, faces)
        return cls(peaks, np.column_stack([key // n, key % n]), highest, total)

    def merged(self, depth: float, oneness: float) -> Ints:
        """New labels ``(n + 1,)`` after both steps of merging."""
        shallow = self._merge_shallow(depth)
        return self._relabelled(shallow)._merge_necks(oneness)[shallow]

    def _merge_shallow(self, depth: float) -> Ints:
        """New labels after merging peaks that hardly rise above their highest saddle."""
        count = len(self.peaks)
        sets, highest = DisjointSet(range(count)), np.arange(count)  # of each set's root, the basin of its highest peak
        for k in np.argsort(-self.saddles, kind="stable"):
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
        return self._gathered(peaks, pairs[apart], self.saddles[apart], self.faces[apart])

    def _merge_necks(self, oneness: float) -> Ints:
        """New labels after merging basins with a wide neck between them, the widest first."""
        count, peaks = len(self.peaks), self.peaks.copy()
        sets, first = DisjointSet(range(count)), np.arange(count)  # of each set's root, its first basin
        necks: list[dict[int, tuple[float, NDArray[np.float64]]]] = [{} for _ in peaks]
        for (a, b), saddle, faces in zip(self.pairs.tolist(), self.saddles.tolist(), self.faces, strict=True):
            necks[a][b] = necks[b][a] = (saddle, faces)
        version = [0] * count
        queue: list[tuple[float, int, int, int, int]] = []

        def offer(a: int, b: int) -> None:
            (saddle, faces), peak = necks[a][b], min(peaks[a], peaks[b])
            # the norm of the numbers of faces is the area of a flat neck of any orientation
            kappa = saddle**2 * float(np.sqrt(faces @ faces)) / (np.pi * peak**4)
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
            version[a], version[b] = version[a] + 1, -1
            for c, (saddle, faces) in necks[b].items():
                del necks[c][b]
                if c != a:
                    old, before = necks[a].get(c, (0.0, 0.0))
                    necks[a][c] = necks[c][a] = (max(saddle, old), faces + before)
            necks[b] = {}
            for c in necks[a]:
                offer(min(a, c), max(a, c))
        return _numbered(first, sets)


def _numbered(representatives: NDArray[np.int64], sets: DisjointSet) -> Ints:
    """Labels ``(n + 1,)`` 0, 1 … of the sets, in the order of the basin that represents each (given for its root)."""
    basins = representatives[[sets[i] for i in range(len(representatives))]]
    return np.asarray(relabel_sequential(basins)[0], np.int32)
