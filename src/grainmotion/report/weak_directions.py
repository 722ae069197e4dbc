"""The direction in which each grain's translation, and about which its rotation, is least well known."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from grainmotion._typing import Float
from grainmotion.report.embedding import Embedded
from grainmotion.report.series_coding import embed_series, embed_sizes

DIRECTION_STEP = 1 / 64  # of the coordinates of directions: about a degree
WEAK_PRECISION = 2e-3  # of standard deviations, relative
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


def weak_directions(covariances: Sequence[Float]) -> dict[str, dict[str, Embedded]]:
    """For the page, from covariances ``(n, 6, 6)`` of each state, mm and radians.

    Of translations (mm) and rotations (degrees): the direction's coordinates ``a`` and ``b`` on an octahedron (Cigolle
    et al., J. Computer Graphics Techniques 3(2), 2014), and the largest and smallest sd.
    """
    found = {}
    for name, part, unit in (("translation", slice(0, 3), 1.0), ("rotation", slice(3, 6), np.rad2deg(1.0))):
        parts = [weakest(of_state[:, part, part]) for of_state in covariances]
        directions, largest, least = (_stacked([p[k] for p in parts]) for k in range(3))
        a, b = octahedral(directions.reshape(*largest.shape, 3))
        found[name] = {
            "a": embed_series(a, DIRECTION_STEP),
            "b": embed_series(b, DIRECTION_STEP),
            "sd": embed_sizes(largest * unit, WEAK_PRECISION),
            "least": embed_sizes(least * unit, WEAK_PRECISION),
        }
    return found


def octahedral(directions: Float) -> tuple[Float, Float]:
    """Two coordinates from −1 to 1 of directions ``(..., 3)``, which may be turned about."""
    x, y, z = np.moveaxis(directions, -1, 0)
    sign = np.where(z < 0, -1.0, 1.0)
    length = np.abs(x) + np.abs(y) + np.abs(z)
    return sign * x / length, sign * y / length


def _stacked(arrays: list[Float]) -> Float:
    return np.stack(arrays) if arrays else np.zeros((0, 0))
