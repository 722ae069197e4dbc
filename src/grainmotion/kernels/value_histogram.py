"""Histograms of single-precision values, exact or fine, from which medians and percentiles of a volume are read.

The bits of a positive single-precision number, as a whole number, rise with it.
"""

from __future__ import annotations

import numba as nb
import numpy as np

from grainmotion.kernels.compilation import CACHE

FINE_SHIFT = 11
"""Bits of the mantissa that fine bins leave out: a bin is as wide as 2**-12 of its value."""


@nb.njit(cache=CACHE, nogil=True)
def count_ordered(values: np.ndarray, groups: np.ndarray, wanted: int, rows: np.ndarray, counts: np.ndarray) -> None:
    """Count the values of a group by the upper 16 bits of their keys, or by the lower ones.

    Keys are whole numbers in the order of the values.  Without ``rows`` upper bits are counted, in ``counts[0]``;
    else lower ones, in the row of ``counts`` that ``rows`` has for the upper ones, -1 for none.  All groups but 0 are
    wanted if ``wanted`` is -1, all values if there are no groups.
    """
    for i in range(len(values)):
        if len(groups) == 0 or groups[i] == wanted or (wanted < 0 and groups[i] != 0):
            bits = np.int64(np.float32(values[i]).view(np.uint32))
            key = bits ^ 0xFFFFFFFF if bits & 0x80000000 else bits | 0x80000000
            if len(rows) == 0:
                counts[0, key >> 16] += 1
            elif rows[key >> 16] >= 0:
                counts[rows[key >> 16], key & 0xFFFF] += 1


@nb.njit(cache=CACHE, nogil=True)
def count_fine(values: np.ndarray, groups: np.ndarray, base: int, counts: np.ndarray) -> None:
    """Count values in fine bins, ``counts (groups, bins)``; group -1 is left out, what is too small is in bin 0."""
    last = counts.shape[1] - 1
    for i in range(len(values)):
        group = groups[i]
        if group >= 0:
            value = np.float32(values[i])
            place = (np.int64(value.view(np.uint32)) >> FINE_SHIFT) - base if value > 0 else np.int64(0)
            counts[group, min(max(place, 0), last)] += 1


@nb.njit(cache=CACHE, nogil=True)
def count_equal_bins(values: np.ndarray, edges: np.ndarray, clip: float, counts: np.ndarray) -> None:
    """Count values in bins of equal width as numpy's histogram does: ``edges[k] <= value < edges[k + 1]``.

    Values above ``clip`` count as it.
    """
    bins = len(counts)
    scale = bins / (np.float64(edges[bins]) - np.float64(edges[0]))
    for i in range(len(values)):
        value = min(values[i], clip)
        if value < edges[0] or value > edges[bins]:
            continue
        place = min(max(int((value - edges[0]) * scale), 0), bins - 1)
        while place > 0 and value < edges[place]:
            place -= 1
        while place < bins - 1 and value >= edges[place + 1]:
            place += 1
        counts[place] += 1
