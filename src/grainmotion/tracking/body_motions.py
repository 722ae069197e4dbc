"""Which bodies moved: each is fixed where it was in the reference unless the radiographs contradict that.

A body of noise and streaks has many minima.  Free to move, it goes into one of them, and the grains move with it by a
fraction of their standard deviations; which minimum that is depends on the last digits of the arithmetic.  So once all
grains are near, the same problem is solved with fixed bodies, and the rise of the cost is compared with the one that
noise alone gives to as many unknowns.  Bodies that moved clearly, by the quadratic model of the cost, are not tried.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import nnls

from grainmotion._typing import Float
from grainmotion.model.pose import NuisanceMotion, Pose
from grainmotion.model.scene import Body
from grainmotion.model.state_fit import BodyMotion
from grainmotion.objective.data_term import Target
from grainmotion.objective.nuisance_motions import NuisanceModel, nuisance_values
from grainmotion.objective.priors import nuisance_prior
from grainmotion.objective.residual import StateProblem
from grainmotion.rotations import rotation_vector
from grainmotion.solvers.block_cg import inverse
from grainmotion.solvers.gauss_newton import Solution, gauss_newton
from grainmotion.solvers.semidefinite import pseudo_inverse
from grainmotion.tracking.multistage import MultistageFit
from grainmotion.uncertainty.noise_model import shaded_pixels, squared_gradient
from grainmotion.uncertainty.rotation_identifiability import UNIFORM_ANGLE_VARIANCE

MOVED_BODY_CHI2 = 10.0
"""χ² over its degrees of freedom from which a body moved: measured 0.5 to 0.8 where it did not, 6.5
for the streaks of a poor reference (15 views, one sweep), which have many minima, 400 for a dense tube
that moved by 0.06 voxel, and as the square of the motion."""
EDGE_CORRELATION, MIN_EDGE_EXCESS = 100.0, 0.5
"""Pixels over which the residual along a body's face is correlated, and its least share of the other variance to
discount it.  Grains between pistons are better by 2 to 20 % than with weights for residuals that are not correlated;
20 and 200 pixels differ by less (decision 0032)."""
BODY_MODEL_ERROR = 0.006
"""Voxels by which a body's surface is off for other reasons than noise: measured up to 0.014 with pistons, 2 to 3 times
their standard deviations by noise, as flat faces seen along themselves are sharper than voxels."""
CLEAR_MOTION_RATIO = 5.0
"""Times that χ², by the quadratic model of the cost, from which a body is not tried fixed: its minima may be many, but
none is at rest."""


def fixed_unless_moved(
    fit: MultistageFit, problem: StateProblem, solution: Solution[Pose]
) -> tuple[StateProblem, Solution[Pose], tuple[int, ...]]:
    """The problem and its solution, with those bodies fixed that did not move, and which these are."""
    target, pose = fit.target, solution.state
    moving = target.nuisance.moving_bodies
    if not moving or pose.nuisance is None:
        return problem, solution, ()
    pixels = int(shaded_pixels(problem.target, problem.evaluate(pose)).sum())
    variance = 2 * solution.costs[-1] / max(pixels, 1) * correlated_pixels(problem.target)
    evidence = _evidence(problem, pose) / max(variance, 1e-30) / MOVED_BODY_CHI2 if len(moving) > 1 else np.zeros(1)
    order = [moving[k] for k in np.argsort(evidence, kind="stable") if evidence[k] < CLEAR_MOTION_RATIO]
    fixed: tuple[int, ...] = ()
    for rows in [tuple(order), *((row,) for row in order if len(order) > 1)]:
        if not rows:
            break
        trial, end = _held(fit, target, pose, (*fixed, *rows))
        unknowns = sum(len(target.nuisance.freedoms[row].ways) for row in (*fixed, *rows))
        if 2 * (end.costs[-1] - solution.costs[-1]) <= MOVED_BODY_CHI2 * unknowns * variance:
            fixed, best = (*fixed, *rows), (trial, end)
            if len(rows) == len(order):
                break
    if not fixed:
        fit.target = target
        return problem, solution, ()
    fit.target = target.with_fixed_bodies(fixed)
    return *best, tuple(sorted(fixed))


def with_body_edges_discounted(
    fit: MultistageFit, problem: StateProblem, solution: Solution[Pose]
) -> tuple[StateProblem, Solution[Pose]]:
    """The problem and its solution with less weight where the images of bodies are steep.

    A flat face seen along itself is sharper than voxels: the reconstruction leaves a residual all along it that is the
    same in all states, and grains that touch the face would follow it.
    """
    if not problem.target.bodies:
        return problem, solution
    evaluation = problem.evaluate(solution.state)
    steepness, shaded = squared_gradient(evaluation.background), shaded_pixels(problem.target, evaluation)
    columns = np.stack([np.ones(int(shaded.sum())), steepness[shaded]], axis=1)
    squares = evaluation.raw_residual[shaded].astype(float) ** 2
    even, edge = nnls(columns.T @ columns, columns.T @ squares)[0]
    if even <= 0 or edge * float(steepness.max()) < MIN_EDGE_EXCESS * even:
        return problem, solution
    discount = 1 / (1 + EDGE_CORRELATION * edge / even * steepness)
    problem = replace(problem, target=replace(problem.target, discount=discount.astype(problem.target.precision)))
    observe = fit.observer(problem.target, "edges of bodies discounted")
    return problem, gauss_newton(problem, solution.state, fit.fine_stopping(), observe)


def _held(fit: MultistageFit, target: Target, pose: Pose, rows: tuple[int, ...]) -> tuple[StateProblem, Solution[Pose]]:
    """The problem with some bodies where they were in the reference, and its solution."""
    assert pose.nuisance is not None
    fit.target = target.with_fixed_bodies(rows)
    translations, matrices = pose.nuisance.translations.copy(), pose.nuisance.matrices.copy()
    translations[list(rows)], matrices[list(rows)] = 0.0, np.eye(3)
    start = Pose(pose.translations, pose.matrices, NuisanceMotion(pose.nuisance.views, translations, matrices))
    return fit.solve_free(start, "bodies held", fit.settings.filters[-1:])


def fixed_note(bodies: tuple[Body, ...], rows: tuple[int, ...]) -> str:
    """The sentence on bodies that were fixed."""
    names = ", ".join(bodies[row].name for row in rows)
    return f"fixed where it was in the reference, since the radiographs do not show a motion: {names}"


def _evidence(problem: StateProblem, pose: Pose) -> Float:
    """Twice the rise of the cost if a body alone is fixed, by the quadratic model, over its unknowns; one a body."""
    nuisance, at = problem.target.nuisance, problem.linearize(pose)
    assert pose.nuisance is not None
    complement = at.corner - at.border.T @ inverse(at.hessian, 0.0)(at.border)
    covariance = pseudo_inverse(complement)[-nuisance.body_unknowns :, -nuisance.body_unknowns :]
    values = nuisance_values(nuisance, pose.nuisance)[-nuisance.body_unknowns :]
    out = []
    for rows in body_rows(nuisance).values():
        out.append(values[rows] @ pseudo_inverse(covariance[rows, rows]) @ values[rows] / (rows.stop - rows.start))
    return np.array(out)


def body_rows(nuisance: NuisanceModel) -> dict[int, slice]:
    """Of each body that may move, its unknowns among those of all bodies."""
    ends = np.cumsum([0, *(len(nuisance.freedoms[k].ways) for k in nuisance.moving_bodies)])
    return {k: slice(int(a), int(b)) for k, a, b in zip(nuisance.moving_bodies, ends[:-1], ends[1:], strict=True)}


def body_covariances(problem: StateProblem, pose: Pose, of_noise: Float) -> NDArray[np.float64]:
    """Covariances ``(k, 6, 6)`` of the bodies' (u, δ), mm and radians; NaN of those that may not move.

    ``of_noise`` is the covariance of the nuisance unknowns by noise.  Along directions that the views do not determine,
    such as the rotation of a disc about its axis, the prior draws an estimate to zero: its error is then the prior's
    own spread.
    """
    nuisance, views = problem.target.nuisance, len(problem.target.scan)
    out = np.full((len(nuisance.freedoms), 6, 6), np.nan)
    if not nuisance.body_unknowns:
        return out
    precisions, _ = nuisance_prior(problem.target, pose)
    free = len(precisions)
    at = problem.linearize(pose)
    complement = at.corner - at.border.T @ inverse(at.hessian, 0.0)(at.border)
    inverse_a = pseudo_inverse(complement, like=np.diagonal(at.corner))[-free:, -free:]
    deviations = nuisance.deviations(views)
    full = of_noise + inverse_a @ precisions @ np.diag(deviations**2) @ precisions @ inverse_a
    full = full[-nuisance.body_unknowns :, -nuisance.body_unknowns :]
    for k, rows in body_rows(nuisance).items():
        basis = nuisance.freedoms[k].basis
        error = BODY_MODEL_ERROR * problem.grains.unit
        spread = np.repeat([error, error / float(problem.target.bodies[k].radii[0])], 3)
        own = basis @ np.linalg.pinv(basis) @ np.diag(spread**2) @ np.linalg.pinv(basis).T @ basis.T
        out[k] = basis @ full[rows, rows] @ basis.T + own
    return out


def body_motions(
    bodies: tuple[Body, ...], nuisance: NuisanceModel, motion: NuisanceMotion | None, covariances: Float
) -> tuple[BodyMotion, ...]:
    """The motion of each body of a scene; its rotation about an axis of symmetry may be any."""
    moving = nuisance.moving_bodies if motion is not None else []
    out = []
    for k, body in enumerate(bodies):
        translation, rotation = np.zeros(3), np.zeros(3)
        if motion is not None and k in moving:
            translation, rotation = motion.translations[k].copy(), rotation_vector(motion.matrices[k])
        covariance = covariances[k].copy() if k < len(covariances) else np.full((6, 6), np.nan)
        if k in moving and nuisance.freedoms[k] != body.freedom and body.symmetry_axis is not None:
            covariance[3:, 3:] += UNIFORM_ANGLE_VARIANCE * np.outer(body.symmetry_axis, body.symmetry_axis)
        out.append(
            BodyMotion(
                body.name, body.kind, body.freedom.text, body.center, translation, rotation, covariance, k in moving
            )
        )
    return tuple(out)


def correlated_pixels(target: Target) -> float:
    """Effective number of pixels over which the filter correlates noise."""
    kernel = target.kernel.astype(float)
    return float(1.0 / (2 * (kernel**2).sum() - kernel[0] ** 2) ** 2)
