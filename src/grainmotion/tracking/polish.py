"""Polish: the last solutions of a state, once every grain is near its place.

Views get poses of their own if they can be told from the sample's motion; pixels get weights, iterated until
they are consistent with the residuals; grains that the views hardly see are held by a prior.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from grainmotion.packed import Pose
from grainmotion.solve import Solution, Stopping, inverse
from grainmotion.tracking.coupling import normal_matrix
from grainmotion.tracking.course import Course
from grainmotion.tracking.covariance import covariances
from grainmotion.tracking.residual import StateProblem
from grainmotion.tracking.stages import rigid
from grainmotion.tracking.turns import unconfirmed
from grainmotion.tracking.weak import weak_directions
from grainmotion.tracking.weighting import reweighted

Float = NDArray[np.float64]

ROUNDS = 3
"""Solutions with new weights: Huber's and the likelihood's change in the fourth digit after these."""
FEWEST_VIEWS = 3
IMITATED = (0, 1, 2, 5)
"""Motions of the whole sample that corrections of all views imitate: its translations, and its turn about z."""
KNOWN = 4.0
"""A combination of corrections is told if the views know it this many times better, in variance, than the prior."""


@dataclass(frozen=True, eq=False)
class Polished:
    """The last problem and its solution, with their uncertainty.

    ``covariances (n, 6, 6)`` of (u, δ) are what the radiographs tell, ``posterior`` the same with the prior that
    held weak directions; ``corrections_sd (views, 3)`` go with poses of views; ``downweighted`` is the share of
    pixels that a robust loss counted less.
    """

    problem: StateProblem
    solution: Solution[Pose]
    covariances: Float
    posterior: Float
    corrections_sd: Float | None = None
    downweighted: float = 0.0
    notes: tuple[str, ...] = ()


def polish(course: Course, base: Pose, problem: StateProblem, solution: Solution[Pose]) -> Polished:
    """Refine a solution in which all grains are near; ``base`` is where the smooth field put them."""
    settings, notes, share = course.settings, list[str](), 0.0
    stopping = Stopping(settings.iterations, settings.tolerance)
    if settings.view_corrections:
        refusal = refused(problem, solution.state)
        if refusal:
            notes.append(refusal)
        else:
            problem = with_poses(problem, solution.state)
            solution = course.solve(problem, solution.state, stopping, "poses of views")
    if settings.weights != "uniform" or settings.loss != "squares":
        plain = problem.target
        for k in range(ROUNDS):
            # the working response of a likelihood replaces the radiographs, so residuals are taken from these
            seen = replace(problem, target=replace(plain, weights=problem.target.weights)).look(solution.state)
            target, share = reweighted(plain, seen, settings.weights, settings.loss)
            problem = replace(problem, target=target)
            solution = course.solve(problem, solution.state, stopping, f"weights {k + 1}")
        if settings.loss == "poisson":  # the working response is no radiograph: what follows compares with these
            problem = replace(problem, target=replace(plain, weights=problem.target.weights, sigma=0.0))
    known, few, formal = _covariances(problem, solution.state)
    weak = weak_directions(known, problem.grains)
    if weak.flags.any():
        held = weak.prior(formal, base)
        problem = replace(problem, prior=held)
        solution = course.solve(problem, solution.state, stopping, "weak directions held")
    corrections_sd = None
    if problem.target.loose.views:
        views = len(problem.target.scan)
        corrections_sd = np.sqrt(np.diagonal(few))[: 3 * views].reshape(3, views).T
    return Polished(problem, solution, known, weak.posterior(), corrections_sd, share, tuple(notes))


def _covariances(problem: StateProblem, pose: Pose) -> tuple[Float, Float, sparse.bsr_array]:
    """What the radiographs tell of the grains ``(n, 6, 6)`` and of the surroundings ``(k, k)``; JᵀJ."""
    seen = problem.look(pose)
    formal = normal_matrix(seen.derivatives, seen.patches, len(problem.grains))
    grains, few = covariances(problem, pose, seen, formal)
    grains[:, 3:, 3:] += unconfirmed(problem, pose, seen)
    return grains, few, formal


def refused(problem: StateProblem, pose: Pose) -> str:
    """Why poses of views cannot be told from the sample's motion; empty if they can."""
    views = len(problem.target.scan)
    if views < FEWEST_VIEWS:
        return (
            f"view corrections refused: {views} views cannot tell them from the sample's own motion; "
            f"take {FEWEST_VIEWS} or more"
        )
    told, count = told_apart(problem, pose)
    if told < count:
        return (
            f"view corrections refused: of {count} combinations that no motion of the sample imitates only {told} "
            "can be told; take more views, or views with more grains on them"
        )
    return ""


def with_poses(problem: StateProblem, pose: Pose) -> StateProblem:
    """The same problem with poses of views unknown, but for what a motion of the whole sample does as well."""
    loose, views = replace(problem.target.loose, views=True), len(problem.target.scan)
    trial = replace(problem, target=replace(problem.target, loose=replace(loose, body=False)))
    seen = trial.look(pose)
    deviations = trial.target.loose.deviations(views)
    alike = seen.loose.border(seen.derivatives, seen.patches, len(problem.grains)) * deviations
    gram = seen.loose.gram() * np.outer(deviations, deviations)
    tie = rigid(problem.grains, pose)[:, list(IMITATED)]
    combinations = np.linalg.pinv(gram, hermitian=True) @ alike.T @ tie
    gauge = np.linalg.qr(combinations / np.linalg.norm(combinations, axis=0))[0]
    if loose.body:
        gauge = np.vstack([gauge, np.zeros((6, gauge.shape[1]))])
    return replace(problem, target=replace(problem.target, loose=replace(loose, gauge=gauge)))


def told_apart(problem: StateProblem, pose: Pose) -> tuple[int, int]:
    """How many combinations of corrections the views know well enough, and how many there are beside the gauge."""
    trial = with_poses(problem, pose)
    views, seen, at = len(problem.target.scan), trial.look(pose), trial.linearize(pose)
    deviations = trial.target.loose.deviations(views)
    prior, _ = trial.surrounding_prior(pose)
    corner = at.corner.copy()
    corner[-len(prior) :, -len(prior) :] -= prior
    left = corner - at.border.T @ inverse(at.hessian, 0.0)(at.border)
    few = len(left) - len(prior)
    own = left[few:, few:] - left[few:, :few] @ np.linalg.pinv(left[:few, :few], hermitian=True) @ left[:few, few:]
    own = (own * np.outer(deviations, deviations))[: 3 * views, : 3 * views]
    gauge = trial.target.loose.gauge
    assert gauge is not None
    open_ones = np.linalg.svd(gauge[: 3 * views])[0][:, gauge.shape[1] :]
    values = np.linalg.eigvalsh(open_ones.T @ own @ open_ones)
    variance = float(np.vdot(seen.raw, seen.raw)) / max(int((trial.target.valid > 0).sum()), 1)
    return int((values > KNOWN * max(variance, 1e-30)).sum()), len(values)
