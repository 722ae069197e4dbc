"""Global search for grains in a wrong place: annealing, then all grains free again, attempt after attempt.

Whether a grain fits badly shows in its residual where the radiographs hold far more pixels than there are unknowns.
Where they do not (*thin* data: a slice, which a few lines of pixels see), wrong placements of many grains can fit
nearly as well as the true one.  There a placement is trusted only if almost nothing is left of the residual, or once
an independent attempt, with other random numbers, comes to the same.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from grainmotion.model.pose import Pose
from grainmotion.objective.global_parameters import dot
from grainmotion.objective.nuisance_motions import body_images
from grainmotion.objective.residual import StateProblem
from grainmotion.projection.grain_arrays import GrainArrays, planar
from grainmotion.rotations import rotation_vector
from grainmotion.solvers.gauss_newton import Solution
from grainmotion.tracking.few_grains import MIN_GRAINS_IN_PARTS, with_neighbours
from grainmotion.tracking.multistage import MultistageFit, pixels_per_unknown
from grainmotion.tracking.simulated_annealing import SearchRanges, anneal
from grainmotion.uncertainty.goodness_of_fit import misfits, misregistered_grains, response_corrected_scan

ANNEAL_ALL_SHARE = 0.3
"""Share of badly fitting grains from which all are annealed, and the fitted gain is not trusted."""
MIN_PROVING_PIXELS = 20.0
"""Pixels an unknown below which a good fit is no proof; see also `classification.MIN_PIXELS_PER_UNKNOWN`."""
MAX_CONFIRMED_GRAINS = 100
"""Grains of a volume up to which placements are confirmed; in larger samples the few in wrong places are not worth
annealing all."""
PERFECT_RESIDUAL = 1e-3
"""Relative residual that proves a placement even of thin data."""
SAME_PLACE_VOXELS = 0.2
"""Voxels between the surfaces of a grain in two placements up to which they are one."""
ATTEMPT_TOLERANCE = 0.01
"""Voxels: tolerance of attempts."""
MAX_VAIN_ATTEMPTS = 2
"""Attempts without improvement after which the search ends, where a good fit is proof."""
MIN_GRAINS_FOR_FIELD = 8
"""Grains to which an affine field is fitted, at least: twice the unknowns of each of its components."""
FIELD_REFITS = 20
"""Reweighted solutions, after which the weights hardly change."""
MIN_CONFIRMED_SHARE = 0.9
"""Share of confirmed grains below which none of a thin placement is trusted."""


def _planar(angle_deg: float, shift: float) -> SearchRanges:
    return SearchRanges(math.radians(angle_deg), shift, grain_pixels=0.0, shift_step=0.5, rotation_step=0.5, sweeps=200)


def _spatial(angle_deg: float, shift: float, sweeps: int) -> SearchRanges:
    return SearchRanges(
        math.radians(angle_deg), shift, grain_pixels=12.0, shift_step=1.0, rotation_step=1.6, sweeps=sweeps
    )


_WIDE_PLANAR, _NARROW_PLANAR = _planar(180, 0.25), replace(_planar(45, 0.1), heat=0.3, cooling=0.03)
PLANAR_ATTEMPTS = (
    *[_NARROW_PLANAR] * 6, _WIDE_PLANAR,
    *[_NARROW_PLANAR] * 6, *[_planar(45, 0.25)] * 2, _WIDE_PLANAR,
    *[_planar(180, 0.5)] * 3, _WIDE_PLANAR,
)  # fmt: skip
SPATIAL_ATTEMPTS = (_spatial(60, 0.5, 20), _spatial(90, 0.5, 40), _spatial(90, 1.0, 40), _spatial(90, 1.0, 60))
"""Ranges of the attempts, one after the other; those over the largest angle can confirm a placement."""
FEW_GRAINS_ATTEMPT = _spatial(90, 1.0, 40)
"""Ranges where few grains fit badly: one attempt at them decides."""


@dataclass(frozen=True, eq=False)
class SearchResult:
    """The last problem of a search, its solution, and the grains ``(n,)`` that another attempt put elsewhere."""

    problem: StateProblem
    solution: Solution[Pose]
    ambiguous: NDArray[np.bool_]


def search(
    fit: MultistageFit,
    field_pose: Pose,
    problem: StateProblem,
    solution: Solution[Pose],
    misregistered: NDArray[np.bool_],
) -> SearchResult:
    """The best of all attempts at a better placement of the grains that fit badly.

    ``field_pose`` is where the smooth field put the grains: misregistered ones are sought around it.  ``problem`` and
    ``solution`` are the free problem and its solution so far, ``misregistered`` the grains that fit badly there.
    """
    flat = planar(fit.grains, fit.target.scan.geometry)
    thin = flat or (
        len(fit.grains) <= MAX_CONFIRMED_GRAINS and pixels_per_unknown(fit.grains, fit.target) < MIN_PROVING_PIXELS
    )
    attempts = PLANAR_ATTEMPTS if flat else SPATIAL_ATTEMPTS
    widest = max(ranges.max_rotation for ranges in attempts)
    best = _Placement(problem, solution)
    confirming, tried, vain = list[_Placement](), 0, 0
    tolerance = max(ATTEMPT_TOLERANCE, fit.settings.tolerance)
    for planned in attempts:
        if tried:
            misregistered = misregistered_grains(best.problem, best.pose) & ~fit.cut
        few = not thin and misregistered.mean() <= ANNEAL_ALL_SHARE
        in_vain = vain >= (1 if few or misregistered.all() else MAX_VAIN_ATTEMPTS)
        if best.proven or (best.agrees(confirming).all() if thin else in_vain or not misregistered.any()):
            break
        tried += 1
        rows, ranges = (misregistered, FEW_GRAINS_ATTEMPT) if few else (np.ones_like(misregistered), planned)
        around = field_pose
        if ranges.max_rotation < widest and tried % 2 == 0:  # the widest ones confirm, and must be independent
            around = affine_field_through(best.pose, fit.grains, field_pose)
        rows = worst_of(best, rows, fit.most_sought) if few else rows
        start = _annealed(fit, around, best, rows, ranges, seed=tried)
        if few and len(fit.grains) >= MIN_GRAINS_IN_PARTS:  # the others are in their places
            some = with_neighbours(best.problem, start, np.flatnonzero(rows))
            end = _Placement(*fit.solve_few(start, some, f"search {tried}", tolerance))
        else:
            end = _Placement(*fit.solve_free(start, f"search {tried}", fit.settings.filters, tolerance))
        vain = 0 if end.cost < 0.99 * best.cost else vain + 1
        best, other = (end, best) if end.cost < best.cost else (best, end)
        if ranges.max_rotation == widest:
            confirming.append(other)
    ambiguous = np.zeros(len(fit.grains), dtype=bool)
    if thin and not best.proven:
        ambiguous = ~best.agrees(confirming)
        ambiguous |= ambiguous.mean() > 1 - MIN_CONFIRMED_SHARE
    if tried:
        best = _Placement(*fit.solve_free(best.pose, "all", fit.settings.filters[-1:]))
    return SearchResult(best.problem, best.solution, ambiguous)


@dataclass(frozen=True, eq=False)
class _Placement:
    """The end of an attempt."""

    problem: StateProblem
    solution: Solution[Pose]

    @property
    def pose(self) -> Pose:
        return self.solution.state

    @property
    def cost(self) -> float:
        return self.solution.costs[-1]

    @property
    def proven(self) -> bool:
        """Whether almost nothing is left of the residual."""
        measured = self.problem.target.measured
        return 2 * self.cost < PERFECT_RESIDUAL**2 * dot(measured, measured)

    def agrees(self, others: list[_Placement]) -> NDArray[np.bool_]:
        """Grains that one of the others put at the same place, ``(n,)``."""
        grains = self.problem.grains
        same = np.zeros(len(grains), dtype=bool)
        for other in others:
            rotations = rotation_vector(other.pose.matrices @ np.swapaxes(self.pose.matrices, 1, 2))
            distances = np.linalg.norm(other.pose.translations - self.pose.translations, axis=1)
            distances += np.linalg.norm(rotations, axis=1) * grains.radii
            same |= distances < SAME_PLACE_VOXELS * grains.unit
        return same


def affine_field_through(pose: Pose, grains: GrainArrays, field_pose: Pose) -> Pose:
    """Translations by an affine field fitted robustly to a pose, with the rotations of ``field_pose``.

    Every second narrow attempt searches around it.  The smooth field that brought the grains near is distorted by those
    that it did not capture; once most grains are in their places, a field through them predicts the others better.
    Distances, not squares, are summed and minimised (by reweighting), so that misplaced grains count little.
    """
    if len(grains) < MIN_GRAINS_FOR_FIELD:
        return field_pose
    places = np.column_stack([np.ones(len(grains)), grains.centers])
    weights = np.ones(len(grains))
    fitted = field_pose.translations
    for _ in range(FIELD_REFITS):
        roots = np.sqrt(weights)[:, None]
        fitted = places @ np.linalg.lstsq(roots * places, roots * pose.translations, rcond=1e-9)[0]
        distances = np.linalg.norm(pose.translations - fitted, axis=1)
        weights = 1.0 / np.maximum(distances, SAME_PLACE_VOXELS * grains.unit)
    return field_pose.moved(fitted, field_pose.matrices)


def worst_of(best: _Placement, rows: NDArray[np.bool_], most: int) -> NDArray[np.bool_]:
    """The grains among ``rows (n,)`` that fit worst, so many at ``most``."""
    if rows.sum() <= most:
        return rows
    fits = misfits(best.problem, best.problem.evaluate(best.pose))
    shares = np.where(rows, np.nan_to_num(fits.shares, nan=np.inf), -np.inf)
    return rows & (shares >= np.sort(shares)[-most])


def _annealed(
    fit: MultistageFit, around: Pose, best: _Placement, rows: NDArray[np.bool_], ranges: SearchRanges, seed: int
) -> Pose:
    """Grains of ``rows`` annealed around a pose, the others fixed where they are best."""
    scan = fit.target.scan if rows.all() else response_corrected_scan(best.problem, best.pose)
    start = best.pose.moved(
        np.where(rows[:, None], around.translations, best.pose.translations),
        np.where(rows[:, None, None], around.matrices, best.pose.matrices),
    )
    target = replace(fit.target, scan=scan)
    if target.nuisance.moving_bodies:  # where the bodies moved to
        views = scan.geometry, target.projector
        images = body_images(target.bodies, target.nuisance, start.nuisance, views, target.fixed_background)
        target = replace(target, fixed_background=images.path)
    return anneal(fit.grains, target, start, np.nonzero(rows)[0], ranges, seed)
