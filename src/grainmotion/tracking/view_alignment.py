"""View alignment: whether views are out of place, whether their poses can be identified, and what stays unknown.

A correction of every view (its detector's shift along u and v, its stage's angle) is identifiable beside the grains'
motions only in part: four combinations have the effect of a motion of the whole sample, and are attributed to that.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from grainmotion._typing import Float
from grainmotion.model.pose import Pose
from grainmotion.objective.displacement_bases import rigid
from grainmotion.objective.global_parameters import dot
from grainmotion.objective.priors import nuisance_prior
from grainmotion.objective.residual import StateProblem
from grainmotion.solvers.block_cg import inverse
from grainmotion.solvers.gauss_newton import Linearization, damped_step, predicted_decrease
from grainmotion.solvers.semidefinite import pseudo_inverse
from grainmotion.uncertainty.goodness_of_fit import misregistered_grains
from grainmotion.uncertainty.noise_model import MIN_TRUST, shaded_pixels

MIN_VIEWS_FOR_ALIGNMENT = 3
IMITATED_MOTIONS = (0, 1, 2, 5)
"""Motions of the whole sample that corrections of all views imitate: its translations, and its rotation about z."""
MIN_SINGULAR_VALUE = 1e-6
"""Singular values below this share of the largest are zero within single precision."""
IDENTIFIABLE_VARIANCE_RATIO = 4.0
"""A combination of corrections is identifiable if prior variance / posterior variance exceeds this."""
CONTRADICTION_CHI2 = 15.0
"""χ² over its degrees of freedom from which views contradict each other: 1 to 10 where they are right, since
residuals are not all noise, 500 and more where they are off by a third of a pixel."""
MIN_MISALIGNMENT = 0.12
"""Pixels below which views are left alone: real residuals imitate 0.1 (`examples/savu`), and the part that cannot be
identified grows with the one that is corrected."""
MIN_GRAINS_FOR_ALIGNMENT = 4
MAX_MISREGISTERED_SHARE = 0.25
"""Share of misregistered grains above which it is these that contradict the views."""


@dataclass(frozen=True)
class ViewMisalignment:
    """How far views are out of place, as far as the radiographs show it.

    ``evidence`` is χ² of the corrections over its degrees of freedom, ``shift`` (pixels) and ``angle`` (radians) are
    standard deviations of a view's, and ``pixels_per_radian`` is how far a projection at the sample's rim moves.
    """

    evidence: float = 0.0
    shift: float = 0.0
    angle: float = 0.0
    pixels_per_radian: float = 0.0

    @property
    def significant(self) -> bool:
        """Whether the views contradict each other by more than residuals explain."""
        largest = max(self.shift, self.angle * self.pixels_per_radian)
        return self.evidence > CONTRADICTION_CHI2 and largest > MIN_MISALIGNMENT

    @property
    def note(self) -> str:
        """The sentence for the user."""
        return (
            f"the views contradict each other as if out of place by {self.shift:.2f} pixel and "
            f"{np.rad2deg(self.angle):.2f} degree: check the geometry; what a motion of the whole sample imitates of "
            "it cannot be identified, and is in the standard deviations"
        )


def view_misalignment(problem: StateProblem, pose: Pose) -> ViewMisalignment:
    """One step's corrections of all views, against those that residuals make likely."""
    views = len(problem.target.scan)
    if views < 2 or len(problem.grains) < MIN_GRAINS_FOR_ALIGNMENT:
        return ViewMisalignment()
    if misregistered_grains(problem, pose).mean() > MAX_MISREGISTERED_SHARE:
        return ViewMisalignment()
    trial = with_view_poses(problem, pose)
    evaluation, at = trial.evaluate(pose), trial.linearize(pose)
    explained, step = _explained(trial, pose, at)
    shaded = shaded_pixels(trial.target, evaluation) & (trial.target.trust >= MIN_TRUST)
    variance = float((evaluation.residual[shaded].astype(float) ** 2).mean()) if shaded.any() else np.inf
    freedom = 3 * views - len(IMITATED_MOTIONS)
    corrections = step[: 3 * views].reshape(3, views)
    places = trial.grains.centers + pose.translations
    return ViewMisalignment(
        explained / max(variance * freedom, 1e-30),
        _spread(corrections[:2], 2 * views - 3),
        _spread(corrections[2], views - 1),
        float(np.abs(places).max()) / trial.target.scan.geometry.pixel_at(places.mean(axis=0)),
    )


def _spread(values: Float, freedom: int) -> float:
    """Standard deviation of a few values, raised for their small number."""
    return float(np.sqrt((values**2).sum() / freedom * (freedom + 2) / freedom))


def common_motion(problem: StateProblem, pose: Pose, misalignment: ViewMisalignment) -> Float:
    """Covariances ``(n, 6, 6)`` by the part of a misalignment that a motion of the whole sample imitates."""
    views = len(problem.target.scan)
    nuisance = problem.target.nuisance
    shift, angle = misalignment.shift / nuisance.view_shift_sd_pixels, misalignment.angle / nuisance.view_angle_sd
    spread = np.repeat([shift] * 2 + [angle], views)
    back = np.linalg.pinv(imitated_corrections(problem, pose), MIN_SINGULAR_VALUE) * spread
    basis = _imitated_basis(problem, pose).reshape(len(problem.grains), 6, -1)
    return np.einsum("nia,ab,njb->nij", basis, back @ back.T, basis)


def _imitated_basis(problem: StateProblem, pose: Pose) -> Float:
    """Increments ``(6n, 4)`` of all grains by a unit of the sample's motions that corrections imitate."""
    return rigid(problem.grains, pose)[:, list(IMITATED_MOTIONS)]


def alignment_refusal(problem: StateProblem, pose: Pose) -> str:
    """Why poses of views cannot be identified beside the sample's motion; empty if they can."""
    views = len(problem.target.scan)
    if views < MIN_VIEWS_FOR_ALIGNMENT:
        return (
            f"view corrections refused: {views} views do not distinguish them from the sample's motion; "
            f"take {MIN_VIEWS_FOR_ALIGNMENT} or more"
        )
    identifiable, count = identifiable_combinations(problem, pose)
    if identifiable < count:
        return (
            f"view corrections refused: of {count} combinations that no motion of the sample imitates only "
            f"{identifiable} can be identified; take more views, or views with more grains on them"
        )
    return ""


def with_view_poses(problem: StateProblem, pose: Pose) -> StateProblem:
    """The same problem with unknown poses of views, without those that a motion of the whole sample imitates."""
    nuisance, combinations = replace(problem.target.nuisance, views=True), imitated_corrections(problem, pose)
    norms = np.linalg.norm(combinations, axis=0)
    gauge = np.linalg.qr(combinations[:, norms > 0] / norms[norms > 0])[0]  # motions that no view sees need no gauge
    gauge = np.vstack([gauge, np.zeros((nuisance.body_unknowns, gauge.shape[1]))])
    return replace(problem, target=replace(problem.target, nuisance=replace(nuisance, gauge=gauge)))


def imitated_corrections(problem: StateProblem, pose: Pose) -> Float:
    """Corrections ``(3 views, 4)``, in the prior's deviations, with the effect of a unit of the sample's motions."""
    nuisance = replace(problem.target.nuisance, views=True, freedoms=(), gauge=None)
    trial = replace(problem, target=replace(problem.target, nuisance=nuisance))
    evaluation = trial.evaluate_with_derivatives(pose)
    columns, deviations = evaluation.nuisance_columns, nuisance.deviations(len(problem.target.scan))
    border = columns.border(evaluation.jacobian) * deviations
    gram = columns.gram() * np.outer(deviations, deviations)
    return np.asarray(pseudo_inverse(gram) @ border.T @ _imitated_basis(problem, pose))


def identifiable_combinations(problem: StateProblem, pose: Pose) -> tuple[int, int]:
    """How many combinations of corrections are identifiable, and how many there are beside the gauge."""
    trial = with_view_poses(problem, pose)
    views, evaluation, at = len(problem.target.scan), trial.evaluate(pose), trial.linearize(pose)
    deviations = trial.target.nuisance.deviations(views)
    information = _information(trial, pose, at) * np.outer(deviations, deviations)
    gauge = trial.target.nuisance.gauge
    assert gauge is not None
    free = np.linalg.svd(gauge[: 3 * views])[0][:, gauge.shape[1] :]
    values = np.linalg.eigvalsh(free.T @ information[: 3 * views, : 3 * views] @ free)
    variance = dot(evaluation.raw_residual, evaluation.raw_residual) / max(int((trial.target.valid > 0).sum()), 1)
    return int((values > IDENTIFIABLE_VARIANCE_RATIO * max(variance, 1e-30)).sum()), len(values)


def _explained(trial: StateProblem, pose: Pose, at: Linearization) -> tuple[float, Float]:
    """Twice the decrease of the cost by the nuisance unknowns, all motions being free, and their step."""
    k = len(at.corner) - len(at.border_gradient)  # unknowns of the response
    without = replace(at, border=at.border[:, :k], corner=at.corner[:k, :k], border_gradient=np.zeros(0))
    full_step, motion_step = damped_step(at, 0.0), damped_step(without, 0.0)
    step = full_step[len(at.gradient) :]
    precisions, _ = nuisance_prior(trial.target, pose)
    decrease = predicted_decrease(at, full_step, 0.0) - predicted_decrease(without, motion_step, 0.0)
    return max(2 * decrease - float(step @ precisions @ step), 0.0), step


def _information(trial: StateProblem, pose: Pose, at: Linearization) -> Float:
    """Information on the nuisance unknowns with all motions free, without their prior."""
    precisions, _ = nuisance_prior(trial.target, pose)
    complement = at.corner - at.border.T @ inverse(at.hessian, 0.0)(at.border)
    k = len(complement) - len(precisions)  # unknowns of the response
    information: Float = complement[k:, k:] - precisions
    if k:
        information = information - complement[k:, :k] @ pseudo_inverse(complement[:k, :k]) @ complement[:k, k:]
    return information
