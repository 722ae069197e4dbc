"""Measures that several studies share."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def relative_difference(values: NDArray[np.floating], wanted: NDArray[np.floating]) -> float:
    """‖values − wanted‖/‖wanted‖ of arrays of one shape."""
    return float(np.linalg.norm((values - wanted).ravel()) / np.linalg.norm(wanted.ravel()))


def rms(values: NDArray[np.floating]) -> float:
    """Root mean square; NaN if there are no values."""
    return float(np.sqrt(np.mean(values**2))) if values.size else float("nan")
