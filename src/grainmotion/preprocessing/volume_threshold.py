"""Otsu's threshold of a whole volume."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from skimage.filters import threshold_otsu

OTSU_BINS = 256
"""Bins of the histogram, as in scikit-image."""


def otsu(array: NDArray[np.floating]) -> float:
    """Otsu's threshold, as `skimage.filters.threshold_otsu` gives it, which makes copies of the whole volume.

    Parameters
    ----------
    array : (nz, ny, nx) array
        Of at least two different values.

    Returns
    -------
    float
        In the unit of the values.
    """
    counts, edges = np.histogram(array.reshape(-1), OTSU_BINS)
    return float(threshold_otsu(hist=(counts, (edges[1:] + edges[:-1]) / 2)))
