"""Discrete ambiguity: other poses of a grain that the radiographs do not tell from the one that was found.

A pose Ω has two kinds of alternatives, from the near-symmetries S of the grain (`self_likeness`).  ΩS, for a rotation
S, carries the grain nearly to itself.  MΩS, for a mirrored S and the mirror M = 1 − 2ddᵀ of a view along d, carries it
nearly to its mirror image, whose projection along d is the same.  One view cannot tell them apart, nor can several if
each has an S of its own: cubes rotated by +a and −a about z project alike in parallel beams at 0°, 45° and 90°.
Since every view must allow an alternative, the mirror of one view is enough to find all.

Each alternative is fitted alone (`alternative_fits`).  A grain moves to one that fits clearly better, or as well and is
nearer to the expected pose; then all grains are fitted together again, and those that moved are asked once more.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from grainmotion._typing import Float
from grainmotion.model.geometry import Geometry
from grainmotion.model.grains import GrainSet
from grainmotion.model.motions import Motions, Status
from grainmotion.model.pose import Pose
from grainmotion.model.progress import counted
from grainmotion.projection.grain_arrays import GrainArrays, planar
from grainmotion.rotations import rotation_vector
from grainmotion.solvers.gauss_newton import gauss_newton
from grainmotion.tracking.alternative_fits import AlternativeFits, fit_alternatives
from grainmotion.tracking.classification import MIN_COVERAGE
from grainmotion.tracking.multistage import MultistageFit
from grainmotion.tracking.refinement import RefinedFit
from grainmotion.tracking.self_likeness import angles_between, find_symmetries, known_symmetries
from grainmotion.tracking.stage_stopping import FIRST_LENGTH_AGAIN
from grainmotion.uncertainty.weak_directions import poorly_determined

NEAREST_TRIED, BEST_TRIED = 3, 3
"""Alternatives of a kind that are fitted: those nearest to the expected pose, and those most alike.  A cube has 23 and
24; any one of them tells that it is ambiguous."""
MIN_CONTRADICTED, MIN_DEVIATIONS = 0.5, 4.0
"""Contradicted share and standard deviations of ‖r‖², both of which the radiographs must reach to tell two poses
apart."""
BETTER_DEVIATIONS, BETTER_DEVIATIONS_OF_MIRRORED = 8.0, 4.0
"""Standard deviations by which ‖r‖² must fall for an alternative to be better than the pose found: faces of the
reference along its rays make one of several equal poses better by up to 5, wrong mirrored poses lose 4 to 7."""
MIN_ANGLE = np.deg2rad(5.0)
"""Between two poses that count as two."""
NAMED_ALTERNATIVES = 3
"""Alternatives named in a reason."""
MAX_MOVES = 2
"""Times that all grains are fitted again because some moved to an alternative."""


class Ambiguities(NamedTuple):
    """``reasons`` of the grains, by row, that are ambiguous, and the pose to go on from if a grain should move.

    ``better`` is whether a grain moves because that fits better, so that its neighbours may fit otherwise too.
    """

    reasons: dict[int, str]
    moved: Pose | None = None
    better: bool = False


def settle_ambiguities(
    fit: MultistageFit, expected: Pose, refined: RefinedFit, grains: GrainSet, limits: tuple[float, float]
) -> tuple[RefinedFit, NDArray[np.bool_], dict[int, str]]:
    """The fit with each grain in the one of its alternative poses that it should be in, which have moved ``(n,)``, and
    reasons by row of those that remain ambiguous.

    If some have moved, all grains are solved again, but the rest of the refinement is still to be done.  A grain whose
    motion is not determined within ``limits``, the largest sd of u (mm) and of ω (rad), has none.
    """
    determined = [not poorly_determined(covariance, limits) for covariance in refined.covariances]
    asked, moved = np.array(determined), np.zeros(len(determined), dtype=bool)
    reasons, settled = dict[int, str](), refined
    for moves in range(MAX_MOVES + 1):
        found = find_ambiguities(settled, (grains, fit.grains), expected, asked)
        reasons = {row: reason for row, reason in reasons.items() if not asked[row]} | found.reasons
        if found.moved is None or moves == MAX_MOVES:
            break
        pose, problem = settled.solution.state, replace(settled.problem, prior=settled.prior)
        now = (found.moved.matrices != pose.matrices).any(axis=(1, 2))
        near, moved = replace(settled.solution, state=found.moved), moved | now
        if found.better or not fit.many:
            observe = fit.observer(problem.target, "alternative poses")
            stopping = fit.coarse_stopping()
            stopping = replace(stopping, first_length=FIRST_LENGTH_AGAIN) if fit.many else stopping
            near = gauss_newton(problem, found.moved, stopping, observe)
        settled = replace(settled, solution=near)
        if fit.many or not found.better:  # as good a pose of one grain changes nothing for the others
            asked = asked & now
    if fit.many or not moved.any():  # many grains are solved again where they are refined again
        return settled, moved, reasons
    problem = replace(settled.problem, prior=settled.prior)
    observe = fit.observer(problem.target, "alternative poses")
    stopping = fit.held_stopping(problem.target)
    settled = replace(settled, solution=gauss_newton(problem, settled.solution.state, stopping, observe))
    return settled, moved, reasons


def find_ambiguities(
    refined: RefinedFit, references: tuple[GrainSet, GrainArrays], expected: Pose, asked: NDArray[np.bool_]
) -> Ambiguities:
    """The ambiguities of the grains ``asked (n,)``; ``references`` are all grains, and their original voxels."""
    problem, pose, evaluation = refined.problem, refined.solution.state, refined.evaluation
    geometry = problem.target.scan.geometry
    if planar(references[1], geometry):
        return Ambiguities({})
    owners, matrices, mirrored = _candidates(
        geometry, pose, evaluation.patches.seen * asked[:, None], references, expected
    )
    if not len(owners):
        return Ambiguities({})
    nearer = angles_between(matrices, expected.matrices[owners])
    wanted = nearer < angles_between(pose.matrices, expected.matrices)[owners]
    fits = fit_alternatives(problem, pose, evaluation, owners, matrices, references[1], wanted)
    away = angles_between(fits.matrices, pose.matrices[owners])
    told_apart = (fits.contradicted > MIN_CONTRADICTED) & (fits.deviations > MIN_DEVIATIONS)
    margins = np.where(mirrored, BETTER_DEVIATIONS_OF_MIRRORED, BETTER_DEVIATIONS)
    better = (fits.contradicted < -MIN_CONTRADICTED) & (fits.deviations < -margins)
    remaining = ~told_apart & (away > MIN_ANGLE)
    fits, better = fits.select(remaining), better[remaining]
    reasons, translations, rotations = {}, pose.translations.copy(), pose.matrices.copy()
    for row in np.unique(fits.owners):
        of_row = fits.owners == row
        own = fits.select(of_row)
        chosen = _preferred(own, better[of_row], pose.matrices[row], expected.matrices[row])
        if chosen is not None:
            translations[row], rotations[row] = own.translations[chosen], own.matrices[chosen]
        reasons[int(row)] = _reason(own.matrices, pose.matrices[row])
    if not (rotations != pose.matrices).any():
        return Ambiguities(reasons)
    return Ambiguities(reasons, pose.moved(translations, rotations), bool(better.any()))


def with_reasons(motions: Motions, reasons: dict[int, str]) -> Motions:
    """The motions with the converged grains among those of ``reasons`` made ambiguous."""
    rows = [row for row in reasons if motions.ok[row]]
    statuses, sentences = motions.statuses.copy(), list(motions.reasons)
    for row in rows:
        statuses[row], sentences[row] = Status.AMBIGUOUS.value, reasons[row]
    return replace(motions, statuses=statuses, reasons=tuple(sentences)) if rows else motions


def _candidates(
    geometry: Geometry, pose: Pose, seen: Float, references: tuple[GrainSet, GrainArrays], expected: Pose
) -> tuple[NDArray[np.int64], Float, NDArray[np.bool_]]:
    """Rows of grains, the rotations from which they are to be fitted ``(k, 3, 3)``, and which are of mirrored poses."""
    owners, matrices, kinds = list[int](), list[Float](), list[bool]()
    grains, reference = references
    asked = np.flatnonzero(seen.mean(axis=1) >= MIN_COVERAGE).tolist()
    find_symmetries(grains.grains, reference, asked)
    for row in counted(asked):
        found = known_symmetries(grains.grains[row], reference, row)
        signs = np.linalg.det(found.matrices)
        view = int(np.argmax(seen[row] > 0.5 * seen[row].max()))
        ray = geometry.source[view]
        if geometry.beam == "cone":
            ray = reference.centers[row] + pose.translations[row] - ray
        mirror = np.eye(3) - 2 * np.outer(ray, ray) / (ray @ ray)
        for mirrored, base in ((False, pose.matrices[row]), (True, mirror @ pose.matrices[row])):
            each = base @ found.matrices[(signs < 0) == mirrored]
            nearest = np.argsort(angles_between(each, expected.matrices[row]), kind="stable")[:NEAREST_TRIED]
            tried = np.union1d(nearest, np.arange(min(BEST_TRIED, len(each))))
            owners += [row] * len(tried)
            matrices += list(each[tried])
            kinds += [mirrored] * len(tried)
    return np.array(owners, dtype=np.int64), np.array(matrices).reshape(-1, 3, 3), np.array(kinds, dtype=bool)


def _preferred(fits: AlternativeFits, better: NDArray[np.bool_], found: Float, expected: Float) -> int | None:
    """Which of a grain's alternatives that are not told from the pose found it should move to, if any."""
    angles = angles_between(fits.matrices, expected)
    if better.any():  # of those that fit as well as the best, the nearest
        as_good = fits.deviations < fits.deviations[better].min() + MIN_DEVIATIONS / 2
        return int(np.argmin(np.where(as_good, angles, np.inf)))
    nearest = int(np.argmin(angles))
    nearer = angles[nearest] < float(angles_between(found, expected)) - MIN_ANGLE
    return nearest if nearer else None


def _reason(alternatives: Float, found: Float) -> str:
    """The sentence that names alternatives by their rotations from the pose found."""
    vectors = rotation_vector(alternatives @ found.T)
    vectors = vectors[np.argsort(np.linalg.norm(vectors, axis=1), kind="stable")]
    names = list(dict.fromkeys(_rotation_name(v) for v in vectors))
    named = ", or ".join(names[:NAMED_ALTERNATIVES]) + ", or others" * (len(names) > NAMED_ALTERNATIVES)
    return (
        f"it looks alike in several poses: rotated further by {named}, it fits the radiographs as well; the pose "
        "nearest to the start is given, which is right if grains rotate by less than half of that from state to state; "
        "else take smaller steps, views from other directions, or use its translation alone"
    )


def _rotation_name(vector: Float) -> str:
    angle = float(np.linalg.norm(vector))
    axis = vector / angle
    if angle > np.pi - MIN_ANGLE and axis[np.argmax(np.abs(axis))] < 0:  # half a turn either way is the same
        axis = -axis
    x, y, z = (f"{value:g}" for value in np.round(axis, 1) + 0.0)
    return f"{np.rad2deg(angle):.0f} degrees about ({x}, {y}, {z})"
