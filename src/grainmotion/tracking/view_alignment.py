"""Poses of the views: whether they are out of place, whether that can be told, and what it leaves unknown.

A correction of every view (its panel's shift along u and v, its stage's angle) is told from the grains' motions
only in part: four combinations do what a motion of the whole sample does, and are taken as such.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from grainmotion._typing import Float
from grainmotion.model.pose import Pose
from grainmotion.objective.displacement_bases import rigid
from grainmotion.objective.evaluation import Evaluation
from grainmotion.objective.global_parameters import dot
from grainmotion.objective.priors import nuisance_prior
from grainmotion.objective.residual import StateProblem
from grainmotion.solvers.block_cg import inverse
from grainmotion.solvers.gauss_newton import Linearization, damped_step, predicted_decrease
from grainmotion.solvers.semidefinite import pseudo_inverse
from grainmotion.uncertainty.goodness_of_fit import misregistered_grains
from grainmotion.uncertainty.noise_model import shaded_pixels

MIN_VIEWS_FOR_ALIGNMENT = 3
IMITATED_MOTIONS = (0, 1, 2, 5)
"""Motions of the whole sample that corrections of all views imitate: its translations, and its turn about z."""
MIN_SINGULAR_VALUE = 1e-6
"""Of the largest singular value: imitations that differ by less are one, as far as single precision tells."""
IDENTIFIABLE_VARIANCE_RATIO = 4.0
"""A combination of corrections is told if the views know it this many times better, in variance, than the prior."""
CONTRADICTION_CHI2 = 15.0
"""χ² over its degrees of freedom from which views contradict each other: 1 to 10 where they stand right, since
residuals are not all noise, 500 and more where they are off by a third of a pixel."""
MIN_MISALIGNMENT = 0.12
"""Pixels below which views are left alone: real residuals imitate 0.1 (`examples/savu`), and what cannot be told
grows with what is told."""
MIN_GRAINS_FOR_ALIGNMENT = 4
MAX_MISREGISTERED_SHARE = 0.25
"""Share of lost grains above which it is these that contradict the views."""


@dataclass(frozen=True)
class ViewMisalignment:
    """How far views are out of place, as far as it shows.

    Attributes
    ----------
    evidence : float
        χ² of the corrections over its degrees of freedom.
    shift, turn : float
        Standard deviation of a view's shift (pixels) and angle (radians).
    arm : float
        Pixels that a shadow at the sample's rim moves per radian.
    """

    evidence: float = 0.0
    shift: float = 0.0
    turn: float = 0.0
    arm: float = 0.0

    @property
    def clearly(self) -> bool:
        """Whether the views contradict each other by more than residuals explain."""
        return self.evidence > CONTRADICTION_CHI2 and max(self.shift, self.turn * self.arm) > MIN_MISALIGNMENT

    @property
    def note(self) -> str:
        """What to tell."""
        return (
            f"the views contradict each other as if out of place by {self.shift:.2f} pixel and "
            f"{np.rad2deg(self.turn):.2f} degree: check the geometry; what a motion of the whole sample imitates of it "
            "cannot be told, and is in the standard deviations"
        )


def view_misalignment(problem: StateProblem, pose: Pose) -> ViewMisalignment:
    """One step's corrections of all views, against what residuals make likely."""
    views = len(problem.target.scan)
    if (
        views < 2
        or len(problem.grains) < MIN_GRAINS_FOR_ALIGNMENT
        or misregistered_grains(problem, pose).mean() > MAX_MISREGISTERED_SHARE
    ):
        return ViewMisalignment()
    trial = with_view_poses(problem, pose)
    evaluation, at = trial.evaluate(pose), trial.linearize(pose)
    explained, step = _explained(trial, pose, at)
    shaded = shaded_pixels(trial.target, evaluation)
    variance = float((evaluation.residual[shaded].astype(float) ** 2).mean()) if shaded.any() else np.inf
    told = 3 * views - len(IMITATED_MOTIONS)
    each = step[: 3 * views].reshape(3, views)
    places = trial.grains.centers + pose.translations
    return ViewMisalignment(
        explained / max(variance * told, 1e-30),
        _spread(each[:2], 2 * views - 3),
        _spread(each[2], views - 1),
        float(np.abs(places).max()) / trial.target.scan.geometry.pixel_at(places.mean(axis=0)),
    )


def _spread(values: Float, response_model: int) -> float:
    """Standard deviation to reckon with from a few values, known the worse the fewer they are."""
    return float(np.sqrt((values**2).sum() / response_model * (response_model + 2) / response_model))


def common_motion(problem: StateProblem, pose: Pose, misalignment: ViewMisalignment) -> Float:
    """Covariances ``(n, 6, 6)`` of what misplaced views and a motion of the whole sample do alike."""
    views = len(problem.target.scan)
    nuisance = problem.target.nuisance
    spread = np.repeat(
        [misalignment.shift / nuisance.view_shift_sd_pixels] * 2 + [misalignment.turn / nuisance.view_angle_sd], views
    )
    back = np.linalg.pinv(imitated_corrections(problem, pose), MIN_SINGULAR_VALUE) * spread
    n = len(problem.grains)
    tie = rigid(problem.grains, pose)[:, list(IMITATED_MOTIONS)].reshape(n, 6, -1)
    return np.einsum("nia,ab,njb->nij", tie, back @ back.T, tie)


def alignment_refusal(problem: StateProblem, pose: Pose) -> str:
    """Why poses of views cannot be told from the sample's motion; empty if they can."""
    views = len(problem.target.scan)
    if views < MIN_VIEWS_FOR_ALIGNMENT:
        return (
            f"view corrections refused: {views} views cannot tell them from the sample's own motion; "
            f"take {MIN_VIEWS_FOR_ALIGNMENT} or more"
        )
    told, count = identifiable_combinations(problem, pose)
    if told < count:
        return (
            f"view corrections refused: of {count} combinations that no motion of the sample imitates only {told} "
            "can be told; take more views, or views with more grains on them"
        )
    return ""


def with_view_poses(problem: StateProblem, pose: Pose) -> StateProblem:
    """The same problem with poses of views unknown, but for what a motion of the whole sample does as well."""
    nuisance, combinations = replace(problem.target.nuisance, views=True), imitated_corrections(problem, pose)
    norms = np.linalg.norm(combinations, axis=0)
    gauge = np.linalg.qr(combinations[:, norms > 0] / norms[norms > 0])[0]  # what no view sees needs no gauge
    if nuisance.background:
        gauge = np.vstack([gauge, np.zeros((6, gauge.shape[1]))])
    return replace(problem, target=replace(problem.target, nuisance=replace(nuisance, gauge=gauge)))


def imitated_corrections(problem: StateProblem, pose: Pose) -> Float:
    """Corrections ``(3 views, 4)``, in the prior's deviations, that do what a unit of the sample's motions does."""
    nuisance = replace(problem.target.nuisance, views=True, background=False, gauge=None)
    trial = replace(problem, target=replace(problem.target, nuisance=nuisance))
    evaluation = trial.evaluate_with_derivatives(pose)
    deviations = nuisance.deviations(len(problem.target.scan))
    alike = (
        evaluation.nuisance_columns.border(evaluation.derivatives, evaluation.patches, len(problem.grains)) * deviations
    )
    gram = evaluation.nuisance_columns.gram() * np.outer(deviations, deviations)
    tie = rigid(problem.grains, pose)[:, list(IMITATED_MOTIONS)]
    found: Float = pseudo_inverse(gram) @ alike.T @ tie
    return found


def identifiable_combinations(problem: StateProblem, pose: Pose) -> tuple[int, int]:
    """How many combinations of corrections the views know well enough, and how many there are beside the gauge."""
    trial = with_view_poses(problem, pose)
    views, evaluation, at = len(problem.target.scan), trial.evaluate(pose), trial.linearize(pose)
    own = _information(trial, pose, at)
    deviations = trial.target.nuisance.deviations(views)
    own = (own * np.outer(deviations, deviations))[: 3 * views, : 3 * views]
    gauge = trial.target.nuisance.gauge
    assert gauge is not None
    open_ones = np.linalg.svd(gauge[: 3 * views])[0][:, gauge.shape[1] :]
    values = np.linalg.eigvalsh(open_ones.T @ own @ open_ones)
    variance = mean_square(trial, evaluation)
    return int((values > IDENTIFIABLE_VARIANCE_RATIO * max(variance, 1e-30)).sum()), len(values)


def mean_square(problem: StateProblem, evaluation: Evaluation) -> float:
    """Of the residuals of all pixels that count."""
    return dot(evaluation.raw_residual, evaluation.raw_residual) / max(int((problem.target.valid > 0).sum()), 1)


def _explained(trial: StateProblem, pose: Pose, at: Linearization) -> tuple[float, Float]:
    """Twice what the nuisance unknowns lower the cost by, all motions being free, and their step."""
    free = len(at.border_gradient)
    few = len(at.corner) - free
    without = replace(at, border=at.border[:, :few], corner=at.corner[:few, :few], border_gradient=np.zeros(0))
    both, alone = damped_step(at, 0.0), damped_step(without, 0.0)
    step = both[len(at.gradient) :]
    prior, _ = nuisance_prior(trial.target, pose)
    lower = predicted_decrease(at, both, 0.0) - predicted_decrease(without, alone, 0.0)
    return max(2 * lower - float(step @ prior @ step), 0.0), step


def _information(trial: StateProblem, pose: Pose, at: Linearization) -> Float:
    """Information on the nuisance unknowns with all motions free, prior apart."""
    prior, _ = nuisance_prior(trial.target, pose)
    left = at.corner - at.border.T @ inverse(at.hessian, 0.0)(at.border)
    few = len(left) - len(prior)
    own: Float = left[few:, few:] - prior
    if few:
        own = own - left[few:, :few] @ pseudo_inverse(left[:few, :few]) @ left[:few, few:]
    return own
