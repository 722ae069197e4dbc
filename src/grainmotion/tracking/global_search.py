"""Grains in a wrong place: annealed, then all free again, attempt after attempt.

Whether a grain fits badly shows in its residual where the radiographs hold far more pixels than there are
unknowns.  Where they do not (a slice, seen in a few lines of pixels), wrong placements of many grains can fit
nearly as well as the true one.  There a placement is trusted if nothing is left of the residual, or once an
attempt of its own, with other random numbers, comes to the same.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from grainmotion.model.pose import Pose
from grainmotion.objective.global_parameters import dot
from grainmotion.objective.nuisance_motions import background_images
from grainmotion.objective.residual import StateProblem
from grainmotion.projection.grain_arrays import GrainArrays, planar
from grainmotion.rotations import rotation_vector
from grainmotion.solvers.gauss_newton import Solution
from grainmotion.tracking.multistage import MultistageFit, pixels_per_unknown
from grainmotion.tracking.simulated_annealing import SearchRanges, anneal
from grainmotion.uncertainty.goodness_of_fit import misregistered_grains, response_corrected_scan

ANNEAL_ALL_SHARE = 0.3  # share of badly fitting grains from which all are annealed, and the fitted gain is not trusted
MIN_PROVING_PIXELS = 20.0
"""Pixels an unknown below which a good fit is no proof; see also `classification.MIN_PIXELS_PER_UNKNOWN`."""
MAX_CONFIRMED_GRAINS = 100  # grains of a volume; of more, the few in wrong places are not worth annealing all of them
PERFECT_RESIDUAL = 1e-3  # relative residual that proves a placement all the same
SAME_PLACE_VOXELS = 0.2  # voxels between the surfaces of a grain in two placements that are one
ATTEMPT_TOLERANCE = 0.01  # voxels: tolerance of attempts
MAX_VAIN_ATTEMPTS = 2  # attempts without a better end after which to give up, where a good fit is proof
MIN_GRAINS_FOR_FIELD = 8  # grains, twice the unknowns of a component of an affine field
FIELD_REFITS = 20  # solutions, after which such weights hardly change
MIN_CONFIRMED_SHARE = 0.9  # share of confirmed grains below which none of a thin placement is trusted


def _planar(angle: float, reach: float) -> SearchRanges:
    return SearchRanges(math.radians(angle), reach, across=0.0, step=0.5, turn_step=0.5, sweeps=200)


def _spatial(angle: float, reach: float, sweeps: int) -> SearchRanges:
    return SearchRanges(math.radians(angle), reach, across=12.0, step=1.0, turn_step=1.6, sweeps=sweeps)


_WIDE_PLANAR, _NARROW_PLANAR = _planar(180, 0.25), replace(_planar(45, 0.1), heat=0.3, cooling=0.03)
PLANAR_ATTEMPTS = (
    *[_NARROW_PLANAR] * 6, _WIDE_PLANAR,
    *[_NARROW_PLANAR] * 6, *[_planar(45, 0.25)] * 2, _WIDE_PLANAR,
    *[_planar(180, 0.5)] * 3, _WIDE_PLANAR,
)  # fmt: skip
SPATIAL_ATTEMPTS = (_spatial(60, 0.5, 20), _spatial(90, 0.5, 40), _spatial(90, 1.0, 40), _spatial(90, 1.0, 60))
"""What attempts range over, one after the other; those over the largest angle can confirm a placement."""
FEW_GRAINS_ATTEMPT = _spatial(90, 1.0, 40)
"""What they range over where few grains are lost: one attempt at them tells."""


@dataclass(frozen=True, eq=False)
class SearchResult:
    """Where a search ended: the last problem, its solution, and the grains that another attempt put elsewhere."""

    problem: StateProblem
    solution: Solution[Pose]
    doubtful: NDArray[np.bool_]


def search(fit: MultistageFit, base: Pose, problem: StateProblem, solution: Solution[Pose]) -> SearchResult:
    """Attempts at a better placement of the grains that fit badly.

    Parameters
    ----------
    course : Course
        The state under way.
    base : Pose
        Where the smooth field put the grains: around it lost ones are sought.
    problem, solution : StateProblem, Solution
        The free problem and its solution so far.

    Returns
    -------
    Found
        The best of all attempts.
    """
    flat = planar(fit.grains, fit.target.scan.geometry)
    thin = flat or (
        len(fit.grains) <= MAX_CONFIRMED_GRAINS and pixels_per_unknown(fit.grains, fit.target) < MIN_PROVING_PIXELS
    )
    plan = PLANAR_ATTEMPTS if flat else SPATIAL_ATTEMPTS
    widest = max(ranges.angle for ranges in plan)
    best = _Attempt(problem, solution)
    confirming, tried, vain = list[_Attempt](), 0, 0
    rough = max(ATTEMPT_TOLERANCE, fit.settings.tolerance)
    for planned in plan:
        lost = misregistered_grains(best.problem, best.pose)
        few = not thin and lost.mean() <= ANNEAL_ALL_SHARE
        in_vain = vain >= (1 if few or lost.all() else MAX_VAIN_ATTEMPTS)
        if best.proven or (best.agrees(confirming).all() if thin else in_vain or not lost.any()):
            break
        tried += 1
        rows, ranges = (lost, FEW_GRAINS_ATTEMPT) if few else (np.ones_like(lost), planned)
        around = base
        if ranges.angle < widest and tried % 2 == 0:  # the widest ones confirm, and must be independent
            around = affine_field_through(best.pose, fit.grains, base)
        start = _annealed(fit, around, best, rows, ranges, seed=tried)
        end = _Attempt(*fit.solve_free(start, f"search {tried}", fit.settings.filters, rough))
        vain = 0 if end.cost < 0.99 * best.cost else vain + 1
        best, other = (end, best) if end.cost < best.cost else (best, end)
        if ranges.angle == widest:
            confirming.append(other)
    doubtful = np.zeros(len(fit.grains), dtype=bool)
    if thin and not best.proven:
        doubtful = ~best.agrees(confirming)
        doubtful |= doubtful.mean() > 1 - MIN_CONFIRMED_SHARE
    if tried:
        best = _Attempt(*fit.solve_free(best.pose, "all", fit.settings.filters[-1:]))
    return SearchResult(best.problem, best.solution, doubtful)


@dataclass(frozen=True, eq=False)
class _Attempt:
    """Where an attempt came to."""

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
        """Whether nothing is left to explain."""
        measured = self.problem.target.measured
        return 2 * self.cost < PERFECT_RESIDUAL**2 * dot(measured, measured)

    def agrees(self, others: list[_Attempt]) -> NDArray[np.bool_]:
        """Grains that one of the others put at the same place, ``(n,)``."""
        grains = self.problem.grains
        same = np.zeros(len(grains), dtype=bool)
        for other in others:
            turns = rotation_vector(other.pose.matrices @ np.swapaxes(self.pose.matrices, 1, 2))
            apart = np.linalg.norm(other.pose.translations - self.pose.translations, axis=1)
            apart += np.linalg.norm(turns, axis=1) * grains.radii
            same |= apart < SAME_PLACE_VOXELS * grains.unit
        return same


def affine_field_through(pose: Pose, grains: GrainArrays, base: Pose) -> Pose:
    """Where an affine field that fits most grains of a pose puts all of them, with the turns of ``base``.

    For every second of the narrow attempts, which planar samples alone have in number.

    The smooth field that brought the grains near is bent by those that it could not reach.  Once most grains are in
    their places, theirs tells better where the others are to be sought; sums of distances, not of squares, are
    minimised (by reweighting), so that those in wrong places count little.  Few grains have no field of their own.
    """
    if len(grains) < MIN_GRAINS_FOR_FIELD:
        return base
    places = np.column_stack([np.ones(len(grains)), grains.centers])
    weights = np.ones(len(grains))
    fitted = base.translations
    for _ in range(FIELD_REFITS):
        roots = np.sqrt(weights)[:, None]
        fitted = places @ np.linalg.lstsq(roots * places, roots * pose.translations, rcond=1e-9)[0]
        weights = 1.0 / np.maximum(np.linalg.norm(pose.translations - fitted, axis=1), SAME_PLACE_VOXELS * grains.unit)
    return base.moved(fitted, base.matrices)


def _annealed(
    fit: MultistageFit, base: Pose, best: _Attempt, rows: NDArray[np.bool_], ranges: SearchRanges, seed: int
) -> Pose:
    """Grains of ``rows`` annealed around ``base``, the others held where they are best."""
    scan = fit.target.scan if rows.all() else response_corrected_scan(best.problem, best.pose)
    start = best.pose.moved(
        np.where(rows[:, None], base.translations, best.pose.translations),
        np.where(rows[:, None, None], base.matrices, best.pose.matrices),
    )
    target = replace(fit.target, scan=scan)
    if target.background is not None and start.nuisance is not None:  # where the background moved to
        images, _ = background_images(target.background, start.nuisance, scan.geometry, target.projector, False)
        target = replace(target, fixed_background=images)
    return anneal(fit.grains, target, start, np.nonzero(rows)[0], ranges, seed)
