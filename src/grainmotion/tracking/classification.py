"""The status of each grain, and the sentence that says why and what to do."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from grainmotion._typing import Float
from grainmotion.diagnosis.reference_errors import ReferenceErrors
from grainmotion.model.grains import GrainSet
from grainmotion.model.motions import Motions, Status
from grainmotion.model.pose import Pose
from grainmotion.model.progress import counted
from grainmotion.model.state_fit import StateFit
from grainmotion.model.usable_parts import POORLY_DETERMINED_REASON
from grainmotion.objective.residual import StateProblem
from grainmotion.rotations import rotation_vector
from grainmotion.solvers.gauss_newton import Solution
from grainmotion.solvers.semidefinite import pseudo_inverse
from grainmotion.tracking.body_motions import body_motions
from grainmotion.tracking.cut_grains import cut_by_panel, cut_reason
from grainmotion.tracking.deformed_grains import find_deformations
from grainmotion.tracking.few_grains import MIN_GRAINS_IN_PARTS, with_neighbours
from grainmotion.tracking.missing_grains import GrainSupport, grain_supports
from grainmotion.tracking.multistage import pixels_per_unknown
from grainmotion.tracking.refinement import RefinedFit
from grainmotion.tracking.strain_stages import strains_of
from grainmotion.tracking.unexplained import unexplained_notes
from grainmotion.uncertainty.goodness_of_fit import misfits
from grainmotion.uncertainty.weak_directions import poorly_determined

AMBIGUOUS_REASON = (
    "another search put it elsewhere, and neither fit is perfect; take more views, or give a nearer start"
)
REFERENCE_REASON = "the reference scan contradicts itself, see the notes on the state"
STILL_MOVING = "still moving when iterations ran out; raise track.iterations"
MAX_DISTURBED_MISFIT = 0.05
"""Residual beyond the noise over line integrals, above which a misregistered neighbour may have shifted a grain."""
MIN_PIXELS_PER_UNKNOWN = 13.0
"""Pixels an unknown below which neighbours may make up for a grain in a wrong place (decision 0015)."""
MIN_COVERAGE = 0.6
"""Share of a grain's projections on the detector below which it has left the field."""
MAX_LAST_STEP_VOXELS = 0.1
"""Displacement by the last step from which a grain still moves, if the solver did not settle."""
MAX_LAST_STEP_SD = 1.0
"""Standard deviations up to which such a step does not matter: rotations that the views hardly determine creep on."""


def classify(
    grains: GrainSet,
    refined: RefinedFit,
    ambiguous: NDArray[np.bool_],
    limits: tuple[float, float],
    costs: tuple[tuple[str, float], ...],
) -> Motions:
    """The motions of a refined fit; ``limits`` are the largest sd of u (mm) and of ω (rad) to accept."""
    problem, solution, n = refined.problem, refined.solution, len(grains)
    evaluation = refined.evaluation
    fits = misfits(problem, evaluation)
    misregistered = fits.misregistered
    cut = grains.cut
    cut_now = ~cut & cut_by_panel(problem, solution.state, evaluation)
    disturbed = _beside(problem, solution.state, misregistered & ~cut & ~cut_now) & ~misregistered
    disturbed &= fits.shares > MAX_DISTURBED_MISFIT
    coverage, moving = evaluation.patches.seen.mean(axis=1), _still_moving(problem, solution, refined.posterior)
    supports = grain_supports(problem, solution.state) if misregistered.any() else [GrainSupport()] * n
    bent = find_deformations(problem, solution.state, evaluation, misregistered)
    places = grains.centers + solution.state.translations
    shared = ReferenceErrors.of(grains.scene.field, problem.target.scan.geometry, places)
    added = bent.covariances + shared.covariances
    verdicts = list[_Verdict]()
    for k in counted(range(n)):
        fit = _GrainFit(
            fits.rms_residuals[k], fits.rms_line_integrals[k], coverage[k], bool(misregistered[k]),
            bool(disturbed[k]), bool(moving[k]), supports[k], cut_reason(bool(cut[k]), bool(cut_now[k])),
        )  # fmt: skip
        rigid = _verdict(fit, refined.covariances[k], limits)
        known = _verdict(fit, refined.covariances[k] + bent.covariances[k], limits)
        verdict = _verdict(fit, refined.covariances[k] + added[k], limits)
        if verdict.status is not known.status:
            verdict = verdict._replace(reason=f"{verdict.reason.partition(';')[0]}; {REFERENCE_REASON}")
        if bent.deformed[k] and rigid.status is Status.CONVERGED:
            verdict = _Verdict(Status.DEFORMED, bent.reasons[k], (verdict.ok[0], False))
        if verdict.status is Status.CONVERGED and ambiguous[k]:
            verdict = _Verdict(Status.NOT_CONVERGED, AMBIGUOUS_REASON)
        verdicts.append(verdict)
    statuses = np.array([verdict.status.value for verdict in verdicts], dtype="<U20")
    notes = (
        *shared.notes,
        *_sparse_note(problem),
        *bent.notes,
        *unexplained_notes(problem, solution.state, evaluation),
    )
    unknown = np.isin(statuses, [Status.LEFT_FIELD.value, Status.NOT_FITTED.value])
    translations, rotations = solution.state.translations.copy(), rotation_vector(solution.state.matrices)
    covariances = refined.posterior + added
    translations[unknown] = rotations[unknown] = np.nan
    covariances[unknown] = np.nan
    usable = np.array([verdict.ok for verdict in verdicts], dtype=bool).reshape(n, 2)
    strains = strain_covariances = None
    if refined.strain_covariances is not None:
        strains, strain_covariances = strains_of(problem.grains), refined.strain_covariances.copy()
        strains[unknown] = np.nan
        strain_covariances[unknown] = np.nan
    return Motions(
        grains.labels, grains.centers, translations, rotations, covariances, statuses, fits.rms_residuals,
        np.full(n, len(costs), dtype=np.int64), tuple(verdict.reason for verdict in verdicts),
        _state_fit(grains, refined, costs, notes),
        usable[:, 0], usable[:, 1], strains, strain_covariances,
    )  # fmt: skip


def _beside(problem: StateProblem, pose: Pose, bad: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Grains ``(n,)`` that one which fits badly may have shifted: all in a small sample, its neighbours in a large."""
    if len(bad) < MIN_GRAINS_IN_PARTS or not bad.any():
        return np.full(len(bad), bad.any())
    return np.isin(np.arange(len(bad)), with_neighbours(problem, pose, np.flatnonzero(bad)))


def _sparse_note(problem: StateProblem) -> tuple[str, ...]:
    """A sentence if the radiographs hold so little that a good fit of a crowd is no proof of each grain's place."""
    pixels = pixels_per_unknown(problem.grains, problem.target)
    if pixels >= MIN_PIXELS_PER_UNKNOWN or not pixels:
        return ()
    return (
        f"{pixels:.0f} pixels for each unknown are few: neighbours can make up for a grain in a wrong place, and its "
        "fit then looks good (5 of 10,000 grains in a trial with 4 views, 7 of 1,000 with 2); take more views to be "
        "sure",
    )


def _state_fit(
    grains: GrainSet, refined: RefinedFit, costs: tuple[tuple[str, float], ...], notes: tuple[str, ...]
) -> StateFit:
    """The fit of the state as a whole."""
    nuisance, motion = refined.problem.target.nuisance, refined.solution.state.nuisance
    response = refined.evaluation.response
    corrections = motion.views if motion is not None and nuisance.views else None
    bodies = body_motions(grains.scene.bodies, nuisance, motion, refined.body_covariances)
    return StateFit(
        response.gain, response.offset, costs, response, corrections, refined.corrections_sd, bodies,
        refined.downweighted, (*refined.notes, *notes),
    )  # fmt: skip


@dataclass(frozen=True)
class _GrainFit:
    """How well one grain fits.

    ``residual`` and ``path`` are rms of its residual and line integrals, ``coverage`` is the share of its projections
    on the detector.
    """

    residual: float
    path: float
    coverage: float
    misregistered: bool
    disturbed: bool
    moving: bool
    support: GrainSupport
    cut: str = ""


class _Verdict(NamedTuple):
    """Status and sentence of a grain, and whether its translation and its rotation are results to use."""

    status: Status
    reason: str = ""
    ok: tuple[bool, bool] = (False, False)


def _verdict(fit: _GrainFit, covariance: Float, limits: tuple[float, float]) -> _Verdict:
    """What became of a grain."""
    if fit.coverage == 0 or not np.isfinite(fit.path):
        return _Verdict(Status.NOT_FITTED, "no view sees it; check its place, or give views or a start that see it")
    if fit.coverage < MIN_COVERAGE:
        share = f"only {fit.coverage:.0%} of its shadows fall on the panel"
        return _Verdict(Status.LEFT_FIELD, f"{share}; take views that hold it, or leave it out")
    if fit.cut:
        return _Verdict(Status.CUT, fit.cut)
    if fit.misregistered:
        return _Verdict(
            Status.NOT_CONVERGED,
            f"its residual {fit.residual:.3g} is too large for its line integrals of {fit.path:.3g}: "
            f"{fit.support.sentence}; give a nearer start, more views, or check its label",
        )
    if fit.disturbed:
        return _Verdict(
            Status.NOT_CONVERGED,
            f"a neighbour fits badly, and its own residual {fit.residual:.3g} is large enough for that to have shifted "
            "it; correct the neighbour first: its label, a nearer start, more views",
        )
    names = poorly_determined(covariance, limits)
    if names:
        return _poorly_determined(names, fit.moving)
    if fit.moving:
        return _Verdict(Status.NOT_CONVERGED, STILL_MOVING)
    return _Verdict(Status.CONVERGED, ok=(True, True))


def _poorly_determined(names: list[str], moving: bool) -> _Verdict:
    """The verdict on a grain of which the directions of ``names`` are not determined."""
    if moving:
        return _Verdict(
            Status.POORLY_DETERMINED,
            f"{POORLY_DETERMINED_REASON}{', '.join(names)}, and translation and rotation were {STILL_MOVING}",
        )
    translation, rotation = (not any(name.startswith(part) for name in names) for part in ("translation", "rotation"))
    cause = "the views do not determine it" if rotation else "the views, or so round a shape, do not determine it"
    rest = "; the rest is a result to use" if translation else ", or use the rest alone"
    reason = f"{POORLY_DETERMINED_REASON}{', '.join(names)}; {cause}, take more views or other angles{rest}"
    return _Verdict(Status.POORLY_DETERMINED, reason, (translation, rotation))


def _still_moving(problem: StateProblem, solution: Solution[Pose], covariances: Float) -> NDArray[np.bool_]:
    """Grains that the last step still moved, if the solver did not settle, by more than their standard deviations."""
    each = solution.last_step[: 6 * len(problem.grains)].reshape(-1, 6)
    if solution.settled:
        return np.zeros(len(each), dtype=bool)
    moved = np.linalg.norm(each[:, :3], axis=1) + np.linalg.norm(each[:, 3:], axis=1) * problem.grains.radii
    squares = np.einsum("ni,nij,nj->n", each, pseudo_inverse(covariances), each)
    return (moved > MAX_LAST_STEP_VOXELS * problem.grains.unit) & (squares > MAX_LAST_STEP_SD**2)
