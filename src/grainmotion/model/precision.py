"""Precision in which images and volumes are kept."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike


def precision_of(array: ArrayLike) -> type[np.floating]:
    """float64 for an array in double precision, float32 for any other."""
    return np.float64 if np.asarray(array).dtype == np.float64 else np.float32
