"""Quantiles of many values that come part by part, such as those of some voxels of each plane of a volume.

The bits of a single-precision number, taken as a whole number, rise with it.  Values are counted by the upper half of
these bits, then those around the quantile by the lower half: exact, without a sorted copy of all values.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator

import numpy as np
from numpy.typing import NDArray

from grainmotion.model.progress import counted

Parts = Callable[[], Iterable[NDArray[np.floating]]]
"""Gives all values, part by part, each time it is called."""
_HALF = 16
"""Bits of half of a single-precision number."""
_SIGN = np.uint32(1 << 31)


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
    upper = np.zeros(1 << _HALF, np.int64)
    for keys in _keys(parts):
        upper += np.bincount((keys >> _HALF).astype(np.uint16), minlength=len(upper))
    ends = np.cumsum(upper)
    if ends[-1] == 0:
        return float("nan")
    place = share * (int(ends[-1]) - 1)
    ranks = [int(place), min(int(place) + 1, int(ends[-1]) - 1)]
    halves = [int(np.searchsorted(ends, rank, side="right")) for rank in ranks]
    lower = {half: np.zeros(1 << _HALF, np.int64) for half in halves}
    for keys in _keys(parts):
        for half, counts in lower.items():
            own = keys[keys >> _HALF == half]
            counts += np.bincount(own.astype(np.uint16), minlength=len(counts))
    values = []
    for rank, half in zip(ranks, halves, strict=True):
        within = rank - int(ends[half] - upper[half])
        key = half << _HALF | int(np.searchsorted(np.cumsum(lower[half]), within, side="right"))
        bits = np.array(key, np.uint32)
        values.append(float((bits ^ _SIGN if bits & _SIGN else ~bits).view(np.float32)))
    return values[0] + (place - ranks[0]) * (values[1] - values[0])


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
