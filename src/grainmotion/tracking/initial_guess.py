"""Initial guess: the given start, then one rigid body, a smooth displacement field and a first free stage."""

from __future__ import annotations

import numpy as np

from grainmotion._typing import Float, Image
from grainmotion.model.pose import Pose
from grainmotion.objective import displacement_bases
from grainmotion.objective.residual import Basis, StateProblem
from grainmotion.solvers.gauss_newton import Solution, gauss_newton
from grainmotion.tracking.expected_rotations import RESIDUAL_WHILE_FAR, near_expected_rotations
from grainmotion.tracking.multiresolution import FIELD_GRAIN_PIXELS
from grainmotion.tracking.multistage import MultistageFit
from grainmotion.tracking.stage_stopping import INITIAL_STOPPING
from grainmotion.uncertainty.goodness_of_fit import misfits

MAX_MISREGISTERED_AT_START = 0.1
"""Share of badly fitting grains from which another start is tried."""
DISPLACEMENT_FIELDS: tuple[tuple[str, Basis, int], ...] = (
    ("affine field", displacement_bases.affine, 6),
    ("quadratic field", displacement_bases.quadratic, 20),
)
"""Smooth fields in turn: name, basis, and the number of grains from which each is fitted."""


def initialise(fit: MultistageFit, pose: Pose, fields: list[Pose]) -> Pose:
    """The pose from which the free stages start: the best after one of the smooth ``fields`` or the given pose.

    A smooth field that moves the sample far can misplace grains that moved little, each in its own way.  So a first
    free stage starts from the last field; only if too many grains then fit badly, it starts from the earlier fields,
    the one body and the plain start as well, and the lowest cost counts.
    """
    fit.leave_out_unseen([pose, *fields][-1])
    if not fields:
        return pose
    width = fit.settings.filters[0]
    problem = StateProblem(*fit.level(width))
    # A drift of the beam is no misfit, so the full response (but hardening) is fitted where grains are compared.
    comparison = StateProblem(fit.grains, fit.filtered_target(width, fit.settings.response_model.without_hardening))
    best: Solution[Pose] | None = None
    for start in [*reversed(fields), pose]:
        observe = fit.observer(problem.target, f"free, filter {width:g}")
        if fit.many:
            problem = near_expected_rotations(problem, start, RESIDUAL_WHILE_FAR)
        solution = gauss_newton(problem, start, fit.coarse_stopping(), observe)
        if best is None or solution.costs[-1] < best.costs[-1]:
            best = solution
            fit.expected = start if problem.prior is not None else None
        evaluation = comparison.evaluate(best.state)
        misregistered = misfits(comparison, evaluation).misregistered_in_crowd
        if (misregistered & ~fit.cut & evaluation.patches.seen.any(axis=1)).mean() < MAX_MISREGISTERED_AT_START:
            break
    assert best is not None
    fit.leave_out_unseen(best.state)
    return best.state


def smooth_fields(fit: MultistageFit, pose: Pose) -> list[Pose]:
    """The poses of one rigid body, from the better of two starts, and of each smooth field."""
    fit.leave_out_unseen(pose)
    grains, target = fit.level(fit.settings.field_filter, least=FIELD_GRAIN_PIXELS)
    problem = StateProblem(grains, target, displacement_bases.rigid)
    starts = [pose, centroid_shift(problem, pose)]
    solutions = []
    for start in starts:
        solutions.append(gauss_newton(problem, start, INITIAL_STOPPING, fit.observer(target, "one body")))
    poses = [min(solutions, key=lambda solution: solution.costs[-1]).state]
    for name, basis, needed in DISPLACEMENT_FIELDS:
        fit.leave_out_unseen(poses[-1])
        if len(fit.grains) >= needed:
            grains, target = fit.level(fit.settings.field_filter, least=FIELD_GRAIN_PIXELS)
            problem = StateProblem(grains, target, basis)
            poses.append(gauss_newton(problem, poses[-1], INITIAL_STOPPING, fit.observer(target, name)).state)
    return poses


def centroid_shift(problem: StateProblem, pose: Pose) -> Pose:
    """All grains shifted by what the centroids of measured and simulated radiographs differ, in least squares."""
    target, geometry = problem.target, problem.target.scan.geometry
    evaluation = problem.evaluate(pose)
    center = (problem.grains.centers + pose.translations).mean(axis=0)
    step = problem.grains.voxel_size
    pixels = geometry.project_points(np.vstack([center, center + step * np.eye(3)]))
    if not np.isfinite(pixels).all():  # the start lies behind a source
        return pose
    derivatives = (pixels[:, 1:] - pixels[:, :1]).transpose(0, 2, 1).reshape(-1, 3) / step
    simulated = evaluation.line_integrals - evaluation.background
    measured = simulated + evaluation.raw_residual
    gaps = _centroids(target.filtered(measured)) - _centroids(target.filtered(simulated))
    shift = np.linalg.lstsq(derivatives, gaps.ravel(), rcond=1e-3)[0]
    return pose.moved(pose.translations + shift, pose.matrices)


def _centroids(images: Image) -> Float:
    """Centres of mass (row, column) of radiographs, ``(views, 2)``."""
    mass = np.maximum(images.sum(axis=(1, 2), dtype=float), 1e-12)
    rows = (images.sum(axis=2, dtype=float) @ np.arange(images.shape[1])) / mass
    columns = (images.sum(axis=1, dtype=float) @ np.arange(images.shape[2])) / mass
    return np.stack([rows, columns], axis=1)
