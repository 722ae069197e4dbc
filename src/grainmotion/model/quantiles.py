"""Exact quantiles of many values, without a sorted copy of all: of some voxels of each plane of a volume, for example.

The bits of a single-precision number, taken as a whole number, rise with it.  Values are counted by the upper half of
these bits, then those around the quantiles by the lower half: here part by part, or by several threads
(`segmentation.percentiles`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from grainmotion.model.progress import counted

Parts = Callable[[], Iterable[NDArray[np.floating]]]
"""Gives all values, part by part, each time it is called."""
Count = Callable[[NDArray[np.int16], NDArray[np.int64]], None]
"""Adds all values to ``counts``, given ``rows``, as `kernels.value_histogram.count_ordered` does."""
_HALF_BITS, _HALF = 16, 1 << 16
"""Bits of half of a single-precision number, and the values that they may have."""
_SIGN = np.uint32(1 << 31)


def quantiles_by_counting(count: Count, shares: Sequence[float]) -> list[float]:
    """Values below which lie shares of all values, from counts of them.

    Parameters
    ----------
    count : callable
        Counts the values; it is called twice.
    shares : sequence of float
        0 to 1; between two values they are interpolated.

    Returns
    -------
    list of float
        In single precision where they are not interpolated; NaN if there are no values.
    """
    upper = np.zeros((1, _HALF), np.int64)
    count(np.zeros(0, np.int16), upper)
    ends = np.cumsum(upper[0])
    last = int(ends[-1]) - 1
    if last < 0:
        return [float("nan")] * len(shares)
    places = [share * last for share in shares]
    ranks = np.array([min(int(place) + more, last) for place in places for more in (0, 1)])
    halves = np.searchsorted(ends, ranks, side="right")
    around = np.unique(halves)
    rows = np.full(_HALF, -1, np.int16)
    rows[around] = np.arange(len(around))
    lower = np.zeros((len(around), _HALF), np.int64)
    count(rows, lower)
    within = np.cumsum(lower, axis=1)
    before = ends[halves] - upper[0, halves]
    keys = [
        half << _HALF_BITS | int(np.searchsorted(within[rows[half]], rank, side="right"))
        for half, rank in zip(halves.tolist(), ranks - before, strict=True)
    ]
    values = [_value(key) for key in keys]
    return [
        low if place == int(place) else low + (place - int(place)) * (high - low)
        for place, low, high in zip(places, values[::2], values[1::2], strict=True)
    ]


def quantile_of_parts(parts: Parts, share: float) -> float:
    """The value below which lies a share of all values.

    Parameters
    ----------
    parts : callable
        Gives the values; it is called twice.
    share : float
        0 to 1; between two values it is interpolated.

    Returns
    -------
    float
        In single precision; NaN if there are no values.
    """

    def count(rows: NDArray[np.int16], counts: NDArray[np.int64]) -> None:
        for keys in _keys(parts):
            if not rows.size:
                counts[0] += np.bincount((keys >> _HALF_BITS).astype(np.uint16), minlength=_HALF)
            for row, half in enumerate(np.flatnonzero(rows >= 0)):
                own = keys[keys >> _HALF_BITS == half]
                counts[row] += np.bincount(own.astype(np.uint16), minlength=_HALF)

    return quantiles_by_counting(count, [share])[0]


def median_of_labels(labels: NDArray[np.integer], values: NDArray[np.floating], wanted: int | None = None) -> float:
    """Median of the values of one label, by default of all labels above 0 together; NaN if there are none."""

    def parts() -> Iterator[NDArray[np.floating]]:
        for plane, own in zip(counted(labels), values, strict=True):
            yield own[plane > 0 if wanted is None else plane == wanted]

    return quantile_of_parts(parts, 0.5)


def _keys(parts: Parts) -> Iterator[NDArray[np.uint32]]:
    """Whole numbers in the order of the values."""
    for values in parts():
        bits = np.ascontiguousarray(values, np.float32).ravel().view(np.uint32)
        yield np.where(bits & _SIGN, ~bits, bits | _SIGN)


def _value(key: int) -> float:
    """The number of a key."""
    bits = np.array(key, np.uint32)
    return float((bits ^ _SIGN if bits & _SIGN else ~bits).view(np.float32))
