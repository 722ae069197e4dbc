"""Otsu's threshold of a whole volume."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from skimage.filters import threshold_otsu

from grainmotion.model.progress import counted

OTSU_BINS = 256
"""Bins of the histogram, as in scikit-image."""
VALUES_COUNTED_TOGETHER = 1 << 24
"""Values after which progress is told."""


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
    flat = array.reshape(-1)
    parts = [flat[first : first + VALUES_COUNTED_TOGETHER] for first in range(0, len(flat), VALUES_COUNTED_TOGETHER)]
    span = min(part.min() for part in counted(parts)), max(part.max() for part in counted(parts))
    counts, edges = np.zeros(OTSU_BINS, np.int64), np.histogram_bin_edges(flat[:1], OTSU_BINS, span)
    for part in counted(parts):
        counts += np.histogram(part, edges)[0]
    return float(threshold_otsu(hist=(counts, (edges[1:] + edges[:-1]) / 2)))
