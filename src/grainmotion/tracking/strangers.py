"""Strangers: what attenuates in a state and is none of the grains, as a grain that appeared or a piece of one.

All views must hold something unexplained at the projections of one place, so the least of them over the views
is what may stand there: a visual hull of the residuals.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from grainmotion.packed import Pose
from grainmotion.tracking.misfit import misfits
from grainmotion.tracking.residual import Glance, StateProblem

Float = NDArray[np.float64]

WIDTH, STEP = 0.5, 0.5
"""Of a grain's radius: the filter under which residuals are looked at, and the places tried."""
MUCH = 0.3
"""Of a grain's line integrals: what counts."""
BEYOND = 1.5
"""Grain radii outside the grains' own box up to which places are tried."""
MOST = 5
"""Strangers named."""


def strangers(problem: StateProblem, pose: Pose, seen: Glance) -> tuple[str, ...]:
    """A sentence for each place where all views hold something that no grain explains."""
    return tuple(
        f"something that is no grain attenuates near x = {x:.3g}, y = {y:.3g}, z = {z:.3g}, "
        f"{share:.0%} of a grain's line integrals: one that appeared, or a piece of one"
        for x, y, z, share in stranger_places(problem, pose, seen)
    )


def stranger_places(problem: StateProblem, pose: Pose, seen: Glance) -> list[tuple[float, float, float, float]]:
    """Those places, mm, x y z, and the share of a grain's line integrals that is unexplained there."""
    grains, geometry = problem.grains, problem.target.scan.geometry
    radius = float(np.median(grains.radii))
    paths = misfits(problem, seen).paths
    usual = float(np.nanmedian(paths)) if np.isfinite(paths).any() else 0.0
    if usual <= 0 or len(problem.target.scan) < 2:
        return []
    places = _places(grains.centers + pose.translations, radius)
    sigma = WIDTH * radius / geometry.pixel_at((grains.centers + pose.translations).mean(axis=0))
    smooth = np.stack([ndimage.gaussian_filter(image.astype(float), sigma) for image in seen.raw])
    least = np.full(len(places), np.inf)
    for image, spots in zip(smooth, geometry.project_points(places), strict=True):
        least = np.minimum(least, ndimage.map_coordinates(image, np.nan_to_num(spots, nan=-1e9).T, order=1, cval=0.0))
    found: list[tuple[float, float, float, float]] = []
    while len(found) < MOST and least.size and least.max() > MUCH * usual:
        best = int(np.argmax(least))
        x, y, z = (float(v) for v in places[best])
        found.append((x, y, z, float(least[best] / usual)))
        least[np.linalg.norm(places - places[best], axis=1) < 3 * radius] = -np.inf
    return found


def _places(centers: Float, radius: float) -> Float:
    """A grid of places in and around the grains ``(k, 3)``, mm, x y z."""
    low, high = centers.min(axis=0) - BEYOND * radius, centers.max(axis=0) + BEYOND * radius
    axes = [np.arange(a, b + STEP * radius, STEP * radius) for a, b in zip(low, high, strict=True)]
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
