"""One number a grain and state, for all states together: as steps from state to state, which compress well.

Values become whole numbers, either multiples of a step or, for what is positive and of any size, logarithms; each less
that of the state before it.  Then as in `embedding`; ``assets/decode.js`` undoes it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from grainmotion._typing import Float
from grainmotion.report.embedding import Embedded, embed, rounded

MISSING_CODE, ZERO_CODE = -(2**31), -(2**31) + 1
"""Whole numbers of what is not finite, and of 0 among logarithms."""
LARGEST = 2**30  # of the whole numbers of values
UNCODED_DIGITS = 6  # of a series with values too large for its step


def embed_series(values: Float, step: float) -> Embedded:
    """Values as multiples of a step.

    Parameters
    ----------
    values : (states, n) array
        NaN where there is none; what is infinite becomes NaN.
    step : float
        Twice the largest error.

    Returns
    -------
    dict
        For the page's JSON: as `embed` returns it, with ``step``.  Values too large for the step are stored as floats.
    """
    known = np.isfinite(values)
    multiples = np.where(known, values, 0.0) / step
    if np.abs(multiples).max(initial=0.0) > LARGEST:
        return embed(rounded(np.where(known, values, np.nan), UNCODED_DIGITS))
    return _steps(np.where(known, np.rint(multiples), MISSING_CODE)) | {"step": step}


def embed_sizes(values: Float, precision: float) -> Embedded:
    """Values from 0 on, to a relative precision.

    Parameters
    ----------
    values : (states, n) array
        NaN where there is none; what is infinite or negative becomes NaN.
    precision : float
        Twice the largest relative error.

    Returns
    -------
    dict
        For the page's JSON: as `embed` returns it, with ``precision``.
    """
    known, some = np.isfinite(values) & (values >= 0), np.isfinite(values) & (values > 0)
    logarithms = np.rint(np.log(np.where(some, values, 1.0)) / precision)
    return _steps(np.where(some, logarithms, np.where(known, ZERO_CODE, MISSING_CODE))) | {"precision": precision}


def _steps(numbers: Float) -> Embedded:
    """Whole numbers ``(states, n)``, each less the one before it modulo 2³², small ones of either sign first."""
    codes: NDArray[np.int32] = numbers.astype(np.int32)
    steps = np.diff(codes.view(np.uint32), axis=0, prepend=np.zeros((1, codes.shape[1]), np.uint32)).view(np.int32)
    return embed(((steps << 1) ^ (steps >> 31)).view(np.uint32))
