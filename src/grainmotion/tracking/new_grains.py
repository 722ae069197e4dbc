"""New grains: attenuation in a state that no grain of the reference explains.

All views must leave something unexplained at the projections of one place, so the least of them over the views bounds
what may be there: a visual hull of the residuals.  `unexplained_notes` names such places to the user.

Unexplained attenuation also draws all grains towards it.  Where a grain too many seems to be on the radiographs, a
ball of the usual size and attenuation is put at the place with most of it and fitted like a grain, so that the others
are not disturbed; the ball's own motion is not reported.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy import ndimage

from grainmotion._typing import Float
from grainmotion.kernels.layout import PADDING
from grainmotion.model.grains import Grain, GrainSet
from grainmotion.model.motions import Motions, Status
from grainmotion.model.pose import Pose
from grainmotion.model.volume import Volume
from grainmotion.objective.evaluation import Evaluation
from grainmotion.objective.residual import StateProblem
from grainmotion.tracking.initial_guess import smooth_fields
from grainmotion.tracking.missing_grains import registered
from grainmotion.tracking.multistage import MultistageFit
from grainmotion.uncertainty.goodness_of_fit import misfits

RESIDUAL_FILTER_RADII, PLACE_STEP_RADII, PLACE_MARGIN_RADII = 0.5, 0.5, 1.5
"""In grain radii: the width of the filter on residuals, the distance between the places that are tried, and how far
they reach beyond the box of the grains' centres."""
UNEXPLAINED_SHARE = 0.3
"""Unexplained line integrals that are reported, as a share of a grain's."""
MAX_NEW_GRAINS = 5
"""Places reported at most."""
SURPLUS_GAIN_SHARE = 0.3
"""Excess of the fitted gain over 1 where a grain has appeared, over one grain's share of all attenuation."""
MIN_DOUBTFUL_SHARE = 0.3
"""Share of grains that must be in doubt before a new grain is supposed."""


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
    centers = grains.centers + pose.translations
    grid = _grid_around(centers, radius)
    sigma = RESIDUAL_FILTER_RADII * radius / geometry.pixel_at(centers.mean(axis=0))
    smooth = np.stack([ndimage.gaussian_filter(image.astype(float), sigma) for image in evaluation.raw_residual])
    least = np.full(len(grid), np.inf)
    for image, pixels in zip(smooth, geometry.project_points(grid), strict=True):
        values = ndimage.map_coordinates(image, np.nan_to_num(pixels, nan=-1e9).T, order=1, cval=0.0)
        least = np.minimum(least, values)
    places: list[tuple[float, float, float, float]] = []
    while len(places) < MAX_NEW_GRAINS and least.size and least.max() > UNEXPLAINED_SHARE * usual:
        best = int(np.argmax(least))
        x, y, z = (float(v) for v in grid[best])
        places.append((x, y, z, float(least[best] / usual)))
        least[np.linalg.norm(grid - grid[best], axis=1) < 3 * radius] = -np.inf
    return places


def _grid_around(centers: Float, radius: float) -> Float:
    """A grid of points in and around the grains ``(k, 3)``, mm, x y z."""
    margin, step = PLACE_MARGIN_RADII * radius, PLACE_STEP_RADII * radius
    low, high = centers.min(axis=0) - margin, centers.max(axis=0) + margin
    axes = [np.arange(a, b + step, step) for a, b in zip(low, high, strict=True)]
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)


def may_have_appeared(measured: Motions) -> bool:
    """Whether a fit looks as if a grain too many were on the radiographs."""
    surplus = measured.fit.gain > 1 + SURPLUS_GAIN_SHARE / len(measured)
    doubtful = ~(registered(measured) | (measured.statuses == Status.ABSENT.value))
    return bool(doubtful.mean() > MIN_DOUBTFUL_SHARE and surplus)


def place_of_new_grain(fit: MultistageFit, start: Pose) -> Float | None:
    """Place of the most unexplained attenuation after the smooth fields, mm, x y z; None if there is none."""
    pose = smooth_fields(fit, start)[-1]
    problem = StateProblem(fit.grains, fit.filtered_target(fit.settings.filters[0]))
    places = unexplained_places(problem, pose, problem.evaluate(pose))
    return np.array(places[0][:3]) if places else None


def with_stand_in(grains: GrainSet, place: Float) -> GrainSet:
    """The sample with a ball at ``place`` (mm, x y z), labelled one beyond the others."""
    masses = [float(g.volume.array.sum(dtype=float)) for g in grains.grains]
    attenuation = float(np.median(np.concatenate([g.volume.array[g.volume.array > 0] for g in grains.grains])))
    radius = grains.voxel_size * float(np.cbrt(3 * np.median(masses) / (4 * np.pi * attenuation)))
    fine = next((g.fine.voxel_size for g in grains.grains if g.fine is not None), None)
    ball = Grain(
        int(grains.labels.max()) + 1,
        _ball(place, radius, attenuation, grains.voxel_size, grains.precision),
        np.asarray(place, dtype=float),
        fine=None if fine is None else _ball(place, radius, attenuation, fine, grains.precision),
    )
    return replace(grains, grains=(*grains.grains, ball))


def _ball(
    place: Float, radius: float, attenuation: float, voxel_size: float, precision: np.dtype[np.floating]
) -> Volume:
    half = int(np.ceil(radius / voxel_size)) + PADDING + 1
    z, y, x = np.mgrid[-half : half + 1, -half : half + 1, -half : half + 1]
    array = attenuation * np.clip(radius / voxel_size - np.sqrt(x**2 + y**2 + z**2) + 0.5, 0, 1)
    return Volume(array.astype(precision), voxel_size, (float(place[0]), float(place[1]), float(place[2])))


def start_with_stand_in(start: Motions | None, grains: GrainSet) -> Motions | None:
    """The start of the sample with a stand-in, which moves from where it was put."""
    return None if start is None else start.for_grains(grains.labels, grains.centers)


def without_last(measured: Motions) -> Motions:
    """The motions of all but the stand-in, with a note on it."""
    x, y, z = measured.centers[-1] + np.nan_to_num(measured.translations[-1])
    note = (
        f"a grain has appeared near x = {x:.3g}, y = {y:.3g}, z = {z:.3g}: a ball stands in for it so that it does "
        "not disturb the others; check the reference for it"
    )
    others = measured.for_grains(measured.labels[:-1], measured.centers[:-1])
    return replace(others, fit=replace(others.fit, notes=(*others.fit.notes, note)))
