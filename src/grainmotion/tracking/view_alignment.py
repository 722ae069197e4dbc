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
from grainmotion.objective.evaluation import LinearizedEvaluation
from grainmotion.objective.global_parameters import Columns, dot
from grainmotion.objective.priors import nuisance_prior
from grainmotion.objective.residual import StateProblem
from grainmotion.solvers.block_cg import inverse
from grainmotion.solvers.gauss_newton import Linearization, damped_step, predicted_decrease
from grainmotion.solvers.semidefinite import pseudo_inverse
from grainmotion.uncertainty.goodness_of_fit import misfits
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
ENOUGH_OF_EVIDENCE = 0.1
"""χ² over its degrees of freedom by which several iterations for many grains must change it to be worth while."""
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
    free = _with_free_views(problem)
    evaluation = free.evaluate_with_derivatives(pose)  # of which all that follows is made
    misregistered = misfits(problem, evaluation).misregistered & (evaluation.patches.seen.mean(axis=1) > 0)
    if misregistered.mean() > MAX_MISREGISTERED_SHARE:
        return ViewMisalignment()
    trial = _with_gauge(free, _imitated(free, pose, evaluation))
    at = trial.linearize_at(pose, evaluation)
    shaded = shaded_pixels(trial.target, evaluation) & (trial.target.trust >= MIN_TRUST)
    variance = float((evaluation.residual[shaded].astype(float) ** 2).mean()) if shaded.any() else np.inf
    chance = max(variance * (3 * views - len(IMITATED_MOTIONS)), 1e-30)
    explained, step = _explained(trial, pose, at, ENOUGH_OF_EVIDENCE * chance)
    corrections = step[: 3 * views].reshape(3, views)
    places = trial.grains.centers + pose.translations
    return ViewMisalignment(
        explained / chance,
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
    return _with_gauge(_with_free_views(problem), imitated_corrections(problem, pose))


def imitated_corrections(problem: StateProblem, pose: Pose) -> Float:
    """Corrections ``(3 views, 4)``, in the prior's deviations, with the effect of a unit of the sample's motions."""
    free = _with_free_views(problem)
    return _imitated(free, pose, free.evaluate_with_derivatives(pose))


def _with_free_views(problem: StateProblem) -> StateProblem:
    """The same problem with unknown poses of views, whatever a motion of the whole sample imitates."""
    return replace(problem, target=replace(problem.target, nuisance=replace(problem.target.nuisance, views=True)))


def _with_gauge(free: StateProblem, combinations: Float) -> StateProblem:
    """The same problem without some ``combinations`` of corrections."""
    nuisance, norms = free.target.nuisance, np.linalg.norm(combinations, axis=0)
    gauge = np.linalg.qr(combinations[:, norms > 0] / norms[norms > 0])[0]  # motions that no view sees need no gauge
    gauge = np.vstack([gauge, np.zeros((nuisance.body_unknowns, gauge.shape[1]))])
    return replace(free, target=replace(free.target, nuisance=replace(nuisance, gauge=gauge)))


def _imitated(free: StateProblem, pose: Pose, evaluation: LinearizedEvaluation) -> Float:
    """`imitated_corrections` from an evaluation with derivatives by them."""
    count, columns = 3 * len(free.target.scan), evaluation.nuisance_columns
    columns = Columns(columns.stacks[:3], columns.shared[:3])  # those of bodies follow
    deviations = free.target.nuisance.deviations(len(free.target.scan))[:count]
    border = columns.border(evaluation.jacobian) * deviations
    gram = columns.gram() * np.outer(deviations, deviations)
    return np.asarray(pseudo_inverse(gram) @ border.T @ _imitated_basis(free, pose))


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


def _explained(trial: StateProblem, pose: Pose, at: Linearization, enough: float) -> tuple[float, Float]:
    """Twice the decrease of the cost by the nuisance unknowns, all motions being free, and their step.

    Iterations for many grains end where they change the cost by less than is ``enough``.
    """
    k = len(at.corner) - len(at.border_gradient)  # unknowns of the response
    without = replace(at, border=at.border[:, :k], corner=at.corner[:k, :k], border_gradient=np.zeros(0))
    full_step, motion_step = (damped_step(one, 0.0, enough=enough) for one in (at, without))
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
