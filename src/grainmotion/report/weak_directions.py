"""The direction in which each grain's translation, and about which its rotation, is least well known."""

from __future__ import annotations

import numpy as np

from grainmotion._typing import Float
from grainmotion.report.embedding import Embedded, embed, rounded

DIRECTION_SCALE = 127  # of components as int8
FIXED = 1e-6  # standard deviation over the largest below which a direction is fixed


def weakest(covariances: Float) -> tuple[Float, Float, Float]:
    """Directions ``(n, 3)`` of the largest standard deviation of 3 × 3 covariances, it, and the smallest one.

    NaN where a covariance is not finite.  Directions in which nothing may move, as in planar samples, do not count.
    """
    n = len(covariances)
    directions, largest, smallest = np.full((n, 3), np.nan), np.full(n, np.nan), np.full(n, np.nan)
    finite = np.isfinite(covariances).all(axis=(1, 2))
    values, vectors = np.linalg.eigh(covariances[finite])
    sd = np.sqrt(np.maximum(values, 0))
    weak = vectors[:, :, -1]
    leading = np.take_along_axis(weak, np.abs(weak).argmax(axis=1)[:, None], axis=1)
    directions[finite] = weak * np.sign(leading)
    largest[finite] = sd[:, -1]
    smallest[finite] = np.where(sd > FIXED * sd[:, -1:], sd, np.inf).min(axis=1, initial=np.inf)
    smallest[~np.isfinite(smallest)] = np.nan
    return directions, largest, smallest


def weak_directions(covariances: Float) -> dict[str, dict[str, Embedded]]:
    """For the page: of translations (mm) and rotations (degrees), the direction (× 127), largest and smallest sd."""
    found = {}
    for name, part, unit in (("translation", slice(0, 3), 1.0), ("rotation", slice(3, 6), np.rad2deg(1.0))):
        directions, largest, smallest = weakest(covariances[:, part, part])
        scaled = np.rint(np.nan_to_num(directions) * DIRECTION_SCALE).astype(np.int8)
        found[name] = {
            "direction": embed(scaled),
            "sd": embed(rounded(largest * unit, 3)),
            "least": embed(rounded(smallest * unit, 3)),
        }
    return found
