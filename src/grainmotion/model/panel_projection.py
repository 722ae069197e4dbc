"""Where the rays through points meet the panels of views."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from grainmotion._typing import Beam, Float


def project_onto_panels(vectors: Float, shape: tuple[int, int], beam: Beam, points: ArrayLike) -> Float:
    """Row and column ``(n, m, 2)`` of points ``(m, 3)`` in views ``(n, 12)``; NaN for a point behind the source."""
    points = np.asarray(points, dtype=float).reshape(-1, 3)
    s, d, u, v = vectors.reshape(-1, 4, 1, 3).swapaxes(0, 1)
    normal, steps = np.cross(u, v).swapaxes(1, 2), np.concatenate([v, u], axis=1)
    # pixels of a shift in the panel's plane: its products with the dual vectors of v and u
    dual = (np.linalg.inv(steps @ steps.swapaxes(1, 2)) @ steps).swapaxes(1, 2)
    with np.errstate(divide="ignore", invalid="ignore"):
        if beam == "cone":
            ray = points - s
            t = ((d - s) @ normal) / (ray @ normal)
            pixels = (s - d) @ dual + np.where(t > 0, t, np.nan) * (ray @ dual)
        else:
            t = ((d - points) @ normal) / (s @ normal)
            pixels = (points - d) @ dual + t * (s @ dual)
    return np.asarray(pixels + (np.array(shape) - 1) / 2)
