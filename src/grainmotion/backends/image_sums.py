"""Radiographs that are sums of patches, from double precision to that of the patches."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from grainmotion.kernels.rounded_sums import round_sums


def in_precision(sums: NDArray[np.float64], dtype: np.dtype[np.floating]) -> NDArray[np.floating]:
    """Sums in the precision of what was added up.

    Two single numbers often add up to the middle between two others.  A third one, a billionth of them, then decides to
    which the sum is rounded; whether it is still there depends on the order of the sum.  So sums are rounded to 40 bits
    first, of which two or three numbers of a size need some 26, and single from there.
    """
    if dtype != np.float32:
        return sums.astype(dtype, copy=False)
    out = np.empty(sums.shape, np.float32)
    round_sums(np.ascontiguousarray(sums).reshape(-1), out.reshape(-1))
    return out
