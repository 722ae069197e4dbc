"""Where the rays through points meet the panels of views."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from grainmotion._typing import Beam, Float


def project_onto_panels(vectors: Float, shape: tuple[int, int], beam: Beam, points: ArrayLike) -> Float:
    """Row and column ``(n, m, 2)`` of points ``(m, 3)`` in views ``(n, 12)``; NaN for a point behind the source."""
    points = np.asarray(points, dtype=float).reshape(-1, 3)
    s, d, u, v = np.split(vectors, 4, axis=1)
    if beam == "cone":
        ray = points[None] - s[:, None]
        start = np.broadcast_to(s[:, None], ray.shape)
    else:
        start = np.broadcast_to(points[None], (len(vectors), len(points), 3))
        ray = np.broadcast_to(s[:, None], start.shape)
    normal = np.cross(u, v)[:, None]
    with np.errstate(divide="ignore", invalid="ignore"):
        t = ((d[:, None] - start) * normal).sum(-1) / (ray * normal).sum(-1)
    if beam == "cone":
        t = np.where(t > 0, t, np.nan)
    hit = start + t[..., None] * ray - d[:, None]
    gram = np.stack(
        [np.stack([(u * u).sum(-1), (u * v).sum(-1)], -1), np.stack([(u * v).sum(-1), (v * v).sum(-1)], -1)], -2
    )
    right = np.stack([(hit * u[:, None]).sum(-1), (hit * v[:, None]).sum(-1)], -1)
    cr = np.linalg.solve(gram[:, None], right[..., None])[..., 0]
    return np.stack([cr[..., 1] + (shape[0] - 1) / 2, cr[..., 0] + (shape[1] - 1) / 2], -1)
