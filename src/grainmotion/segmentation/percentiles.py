"""Medians and percentiles of the voxels of a volume, from histograms instead of sorted copies."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from grainmotion.kernels.value_histogram import FINE_SHIFT, count_fine, count_ordered
from grainmotion.model.quantiles import quantiles_by_counting
from grainmotion.segmentation.blocks import Work, chunks_of

_ALL = np.zeros(0, np.uint8)
_OCTAVES = 24
"""Powers of two over which fine bins reach below the highest value."""


def quantiles(
    work: Work, values: NDArray, shares: Sequence[float], groups: NDArray | None = None, wanted: int = -1
) -> list[float]:
    """Values below which lie shares of a group, as `numpy.quantile` gives them, to single precision.

    Parameters
    ----------
    work : Work
        Threads.
    values : array
        Of whatever shape.
    shares : sequence of float
        0 … 1.
    groups : array, optional
        Whole number of each value; all values unless given.
    wanted : int
        Group that counts; all but 0 unless given.

    Returns
    -------
    list of float
        NaN if the group is empty.
    """
    flat = values.reshape(-1)
    own = _ALL if groups is None else groups.reshape(-1)
    chunks = chunks_of(flat.size)

    def count(rows: NDArray[np.int16], counts: NDArray[np.int64]) -> None:
        def add(part: slice, found: NDArray[np.int64]) -> NDArray[np.int64]:
            count_ordered(flat[part], own[part] if own.size else own, wanted, rows, found)
            return found

        counts += sum(work.gathered(chunks, partial(np.zeros_like, counts), add))

    return quantiles_by_counting(count, shares)


def median(work: Work, values: NDArray, groups: NDArray | None = None, wanted: int = -1) -> float:
    """The median of a group of values (see `quantiles`)."""
    return quantiles(work, values, [0.5], groups, wanted)[0]


@dataclass(frozen=True)
class FineBins:
    """Bins of positive values, each as wide as 2**-12 of the value; what is far below the highest is in bin 0."""

    base: int
    count: int

    @classmethod
    def up_to(cls, highest: float) -> FineBins:
        """Bins for values up to the highest one."""
        top = _bits(max(highest, 1e-30)) >> FINE_SHIFT
        count = min(_OCTAVES << (23 - FINE_SHIFT), top)
        return cls(top - count, count + 1)

    def empty(self, groups: int) -> NDArray[np.int64]:
        """Counts ``(groups, count)``."""
        return np.zeros((groups, self.count), np.int64)

    def add(self, values: NDArray, groups: NDArray, counts: NDArray[np.int64]) -> None:
        """Count values, each in its group, -1 for none."""
        count_fine(
            np.ascontiguousarray(values).reshape(-1), np.ascontiguousarray(groups).reshape(-1), self.base, counts
        )

    @property
    def edges(self) -> NDArray[np.float64]:
        """Lower edges of the bins, and the upper one of the last; 0 for the first."""
        bits = (np.arange(self.count + 1, dtype=np.int64) + self.base) << FINE_SHIFT
        edges = bits.astype(np.uint32).view(np.float32).astype(float)
        edges[0] = 0.0
        return edges

    @property
    def middle(self) -> NDArray[np.float64]:
        """Values in the middle of the bins, 0 for the first."""
        middle = (self.edges[:-1] + self.edges[1:]) / 2
        middle[0] = 0.0
        return np.asarray(middle)

    def quantile(self, counts: NDArray[np.int64], share: float) -> float:
        """The value below which lies a share, NaN of nothing."""
        total = np.cumsum(counts)
        if total[-1] == 0:
            return float("nan")
        rank = share * (int(total[-1]) - 1) + 0.5
        k = int(np.searchsorted(total, rank))
        if k == 0:
            return 0.0
        edges = self.edges
        return float(edges[k] + (edges[k + 1] - edges[k]) * (rank - (total[k] - counts[k])) / counts[k])


def _bits(value: float) -> int:
    return int(np.array(value, np.float32).view(np.uint32))
