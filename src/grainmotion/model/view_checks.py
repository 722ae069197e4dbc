"""Views that no image can have: NaN, steps of zero length or parallel, rays inside the panel's plane."""

from __future__ import annotations

import numpy as np

from grainmotion._typing import Beam, Float
from grainmotion.errors import InputError

VIEW_COLUMNS = ("sx", "sy", "sz", "dx", "dy", "dz", "ux", "uy", "uz", "vx", "vy", "vz")


def check_views(vectors: Float, beam: Beam) -> None:
    """Refuse views ``(n, 12)`` that are at fault, and name the first of them."""
    if _are_fine(vectors, beam):
        return
    for i, row in enumerate(vectors):
        where = f"geometry view {i} (row {i + 1})"
        if not np.isfinite(row).all():
            raise InputError(where, "it holds NaN or infinity", "give 12 finite numbers")
        s, d, u, v = row[:3], row[3:6], row[6:9], row[9:]
        lengths = np.linalg.norm(u), np.linalg.norm(v)
        if min(lengths) == 0:
            raise InputError(where, "u or v has zero length", "give the steps between columns and between rows, in mm")
        normal = np.cross(u, v)
        if np.linalg.norm(normal) < 1e-6 * lengths[0] * lengths[1]:
            raise InputError(where, "u and v are parallel", "give the steps between columns and between rows, in mm")
        ray = d - s if beam == "cone" else s
        if abs(ray @ normal) < 1e-9 * np.linalg.norm(ray) * np.linalg.norm(normal) or not ray.any():
            raise InputError(where, "the rays run inside the panel's plane", "check the source or direction and u, v")


def _are_fine(vectors: Float, beam: Beam) -> bool:
    """Whether no view is at fault, for all views at once: many geometries are made when mistakes are looked for.

    A little stricter than the loop that names the view.
    """
    if not np.isfinite(vectors).all():
        return False
    s, d, u, v = vectors[:, :3], vectors[:, 3:6], vectors[:, 6:9], vectors[:, 9:]
    n = np.stack([u[:, 1] * v[:, 2] - u[:, 2] * v[:, 1], u[:, 2] * v[:, 0] - u[:, 0] * v[:, 2],
                  u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]], axis=1)  # fmt: skip
    ray = d - s if beam == "cone" else s
    uu, vv, nn, rr, rn = ((a * b).sum(axis=1) for a, b in ((u, u), (v, v), (n, n), (ray, ray), (ray, n)))
    return bool((nn > 1.01e-12 * uu * vv).all() and (rn**2 > 1.01e-18 * rr * nn).all())
