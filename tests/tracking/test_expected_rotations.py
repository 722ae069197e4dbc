"""Rotations kept near expected ones while grains are brought near (`tracking.expected_rotations`)."""

import numpy as np
import pytest

import many_small_grains as many
from grainmotion.model.pose import Pose
from grainmotion.objective.data_term import Target
from grainmotion.objective.residual import StateProblem
from grainmotion.projection.grain_arrays import GrainArrays
from grainmotion.rotations import rotation_matrix, rotation_vector
from grainmotion.solvers.gauss_newton import gauss_newton
from grainmotion.solvers.stopping import Stopping
from grainmotion.tracking.expected_rotations import near_expected_rotations
from grainmotion.uncertainty.weak_directions import PRIOR_ROTATION


def problem_and_truth(sigma):
    grains, views = many.block(2), many.views(2)
    scan, truth = many.state(grains, views)
    target = Target(scan, np.zeros(scan.line_integrals.shape), "trilinear", sigma)
    return StateProblem(GrainArrays.of(grains), target), truth


def test_only_rotations_away_from_the_expected_ones_cost():
    problem, _ = problem_and_truth(0.7)
    still, n = many.still(8), 8
    held = near_expected_rotations(problem, still, residual=0.1)
    square = float((problem.target.measured.astype(float) ** 2).mean())

    def added(pose):
        return held.cost(pose) - problem.cost(pose)

    assert added(still) == 0
    assert added(still.moved(still.translations + 0.3, still.matrices)) == 0
    rotated = still.moved(still.translations, rotation_matrix(np.tile([0.1, 0.0, 0.0], (n, 1))))
    assert added(rotated) == pytest.approx(0.5 * n * 0.1**2 * square * (0.1 / PRIOR_ROTATION) ** 2, rel=1e-3)


def test_a_wide_filter_leaves_less_to_each_pixel():
    """Its residuals are alike over more pixels, so that it takes more of them to rotate a grain."""
    narrow, wide = (near_expected_rotations(problem_and_truth(s)[0], many.still(8), 0.1) for s in (1.0, 3.0))
    squares = [float((p.target.measured.astype(float) ** 2).mean()) for p in (narrow, wide)]
    traces = [np.trace(p.prior.precisions, axis1=1, axis2=2) for p in (narrow, wide)]
    np.testing.assert_allclose(traces[1] / traces[0], 9.0 * squares[1] / squares[0])


def test_rotations_under_a_wide_filter_do_not_run_away():
    """Small grains whose rotations it hardly shows: they end nearer to their true rotations, of 1 degree or so."""
    problem, truth = problem_and_truth(3.0)
    errors = []
    for some in (problem, near_expected_rotations(problem, many.still(8), 0.1)):
        end: Pose = gauss_newton(some, many.still(8), Stopping(iterations=8, step=1e-3)).state
        rotations = rotation_vector(end.matrices @ truth.matrices.transpose(0, 2, 1))
        errors.append(np.rad2deg(np.sqrt((rotations**2).mean())))
    assert errors[1] < 0.5 * errors[0]
    assert errors[1] < 2.5
