"""Attenuation in a state that no grain of the reference explains.

All views must leave something unexplained at the projections of one place, so the least of them over the views bounds
what may be there: a visual hull of the residuals.  `unexplained_notes` names such places to the user.
"""

from __future__ import annotations

import numpy as np
from scipy import ndimage

from grainmotion._typing import Float, Image
from grainmotion.model.geometry import Geometry
from grainmotion.model.pose import Pose
from grainmotion.objective.evaluation import Evaluation
from grainmotion.objective.residual import StateProblem
from grainmotion.uncertainty.goodness_of_fit import misfits

RESIDUAL_FILTER_RADII, PLACE_STEP_RADII, PLACE_MARGIN_RADII = 0.5, 0.5, 1.5
"""In grain radii: the width of the filter on residuals, the distance between the places that are tried, and how far
they reach beyond the box of the grains' centres."""
UNEXPLAINED_SHARE = 0.3
"""Unexplained line integrals that are reported, as a share of a grain's."""
MAX_PLACES = 5
"""Places reported at most."""


def unexplained_notes(problem: StateProblem, pose: Pose, evaluation: Evaluation) -> tuple[str, ...]:
    """A sentence for each place where all views hold something that no grain explains."""
    return tuple(
        f"something that is no grain attenuates near x = {x:.3g}, y = {y:.3g}, z = {z:.3g}, "
        f"{share:.0%} of a grain's line integrals: one that appeared, or a piece of one"
        for x, y, z, share in unexplained_places(problem, pose, evaluation)
    )


def unexplained_places(
    problem: StateProblem, pose: Pose, evaluation: Evaluation
) -> list[tuple[float, float, float, float]]:
    """Places of unexplained attenuation (mm, x y z), and its line integrals there over those of a grain."""
    grains, geometry = problem.grains, problem.target.scan.geometry
    radius = float(np.median(grains.radii))
    of_grains = misfits(problem, evaluation).rms_line_integrals
    usual = float(np.nanmedian(of_grains)) if np.isfinite(of_grains).any() else 0.0
    if usual <= 0 or len(problem.target.scan) < 2:
        return []
    grid = grid_around(grains.centers + pose.translations, radius)
    least = least_over_views(evaluation.raw_residual, geometry, grid, radius)
    places: list[tuple[float, float, float, float]] = []
    while len(places) < MAX_PLACES and least.size and least.max() > UNEXPLAINED_SHARE * usual:
        best = int(np.argmax(least))
        x, y, z = (float(v) for v in grid[best])
        places.append((x, y, z, float(least[best] / usual)))
        least[np.linalg.norm(grid - grid[best], axis=1) < 3 * radius] = -np.inf
    return places


def least_over_views(residual: Image, geometry: Geometry, grid: Float, radius: float) -> Float:
    """Filtered residual radiographs at the projections of points ``(k, 3)``, the least of all views, ``(k,)``."""
    sigma = RESIDUAL_FILTER_RADII * radius / geometry.pixel_at(grid.mean(axis=0))
    least = np.full(len(grid), np.inf)
    for image, pixels in zip(residual, geometry.project_points(grid), strict=True):
        smooth = ndimage.gaussian_filter(image.astype(float), sigma)
        values = ndimage.map_coordinates(smooth, np.nan_to_num(pixels, nan=-1e9).T, order=1, cval=0.0)
        least = np.minimum(least, values)
    return least


def grid_around(centers: Float, radius: float) -> Float:
    """A grid of points in and around the grains ``(k, 3)``, mm, x y z."""
    margin, step = PLACE_MARGIN_RADII * radius, PLACE_STEP_RADII * radius
    low, high = centers.min(axis=0) - margin, centers.max(axis=0) + margin
    axes = [np.arange(a, b + step, step) for a, b in zip(low, high, strict=True)]
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
