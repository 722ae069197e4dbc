"""The grey scale of images."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from grainmotion._typing import Image


@dataclass(frozen=True)
class GreyScale:
    """A linear scale from black at ``low`` to white at ``high``."""

    low: float
    high: float


def grey_scale(*images: Image) -> GreyScale:
    """One grey scale for several images, from 0 or the darkest to the brightest; 1 pixel in 500 clipped."""
    values = np.concatenate([image[np.isfinite(image)].ravel() for image in images])
    if values.size == 0:
        return GreyScale(0.0, 1.0)
    low, high = np.percentile(values, [0.1, 99.9])
    if 0 < low < 0.5 * high:
        low = 0.0
    return GreyScale(float(low), float(high) if high > low else float(low) + 1.0)
