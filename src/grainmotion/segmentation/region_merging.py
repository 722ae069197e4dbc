"""The graph of touching watershed basins, and which of them are one grain (see `segment`)."""

from __future__ import annotations

import heapq
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

Ints = NDArray[np.int32]

UNEVEN = 0.9  # a saddle above this share of the lower peak separates nothing


@dataclass(frozen=True, eq=False)
class BasinGraph:
    """Touching basins 1 … n: ``peaks (n + 1,)`` of the distance; each pair's saddle and its faces along z, y, x."""

    peaks: NDArray[np.float64]
    pairs: NDArray[np.int64]  # (k, 2)
    saddles: NDArray[np.float64]  # (k,)
    faces: NDArray[np.float64]  # (k, 3)

    @classmethod
    def of(cls, distance: NDArray[np.float32], basins: Ints) -> BasinGraph:
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
        """From pairs that may come many times and either way round."""
        n = len(peaks)
        key, index = np.unique(pairs.min(axis=1).astype(np.int64) * n + pairs.max(axis=1), return_inverse=True)
        highest, total = np.zeros(len(key)), np.zeros((len(key), 3))
        np.maximum.at(highest, index, saddles)
        np.add.at(total, index, faces)
        return cls(peaks, np.column_stack([key // n, key % n]), highest, total)

    def joined(self, depth: float, oneness: float) -> Ints:
        """New labels ``(n + 1,)`` once all that is one grain has joined."""
        shallow = self._join_shallow(depth)
        return self._under(shallow)._join_necks(oneness)[shallow]

    def _join_shallow(self, depth: float) -> Ints:
        """New labels once peaks that hardly stand above their highest saddle have joined."""
        root = np.arange(len(self.peaks))
        for k in np.argsort(-self.saddles, kind="stable"):
            a, b = (_find(root, int(i)) for i in self.pairs[k])
            low, high = (a, b) if self.peaks[a] < self.peaks[b] else (b, a)
            peak, saddle = self.peaks[low], self.saddles[k]
            if a != b and (peak - saddle < depth or saddle > UNEVEN * peak):
                root[low] = high
        return renumbered(np.array([_find(root, i) for i in range(len(root))]))

    def _under(self, labels: Ints) -> BasinGraph:
        """The graph of basins joined under new labels."""
        peaks = np.zeros(int(labels.max()) + 1)
        np.maximum.at(peaks, labels, self.peaks)
        pairs = labels[self.pairs]
        apart = pairs[:, 0] != pairs[:, 1]
        return self._gathered(peaks, pairs[apart], self.saddles[apart], self.faces[apart])

    def _join_necks(self, oneness: float) -> Ints:
        """New labels once basins with a wide neck between them have joined, the widest first."""
        root, peaks = np.arange(len(self.peaks)), self.peaks.copy()
        necks: list[dict[int, tuple[float, NDArray[np.float64]]]] = [{} for _ in root]
        for (a, b), saddle, faces in zip(self.pairs.tolist(), self.saddles.tolist(), self.faces, strict=True):
            necks[a][b] = necks[b][a] = (saddle, faces)
        version = [0] * len(root)
        queue: list[tuple[float, int, int, int, int]] = []

        def offer(a: int, b: int) -> None:
            (saddle, faces), peak = necks[a][b], min(peaks[a], peaks[b])
            # the norm of the faces' numbers is the area of a flat neck, whichever way it looks
            kappa = saddle**2 * float(np.sqrt(faces @ faces)) / (np.pi * peak**4)
            if kappa >= oneness:
                heapq.heappush(queue, (-kappa, a, b, version[a], version[b]))

        for a, b in self.pairs.tolist():
            offer(a, b)
        while queue:
            _, a, b, va, vb = heapq.heappop(queue)
            if version[a] != va or version[b] != vb:
                continue
            root[b] = a
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
        return renumbered(np.array([_find(root, i) for i in range(len(root))]))


def _find(root: NDArray[np.int64], i: int) -> int:
    while root[i] != i:
        root[i] = root[root[i]]
        i = int(root[i])
    return i


def renumbered(labels: NDArray[np.integer]) -> Ints:
    """The same partition with 0 kept and the others numbered 1 … n."""
    values, index = np.unique(np.concatenate([[0], labels]), return_inverse=True)
    assert values[0] == 0
    return index[1:].astype(np.int32)
