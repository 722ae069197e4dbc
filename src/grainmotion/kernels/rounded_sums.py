"""Sums in double precision made single, so that what is lost in the last digit of the sum does not show."""

from __future__ import annotations

import numba as nb
import numpy as np

from grainmotion.kernels.compilation import CACHE

SPLITTER = float((1 << 13) + 1)
"""By which a double number is cut to its first 40 bits (Dekker 1971)."""


@nb.njit(cache=CACHE, nogil=True, error_model="numpy")
def round_sums(sums, out):
    """Fill ``out``, single, with ``sums``, double, rounded to 40 bits before; both flat."""
    for k in range(len(sums)):
        wide = sums[k] * SPLITTER
        out[k] = np.float32(wide - (wide - sums[k]))
