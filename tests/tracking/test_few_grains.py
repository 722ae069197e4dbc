"""A few of many grains alone (`tracking.few_grains`): the same problem with the others fixed."""

import numpy as np
import pytest

import many_small_grains as many
from grainmotion.model.pose import Pose
from grainmotion.objective.data_term import Target
from grainmotion.objective.residual import StateProblem
from grainmotion.projection.grain_arrays import GrainArrays
from grainmotion.solvers.gauss_newton import gauss_newton
from grainmotion.solvers.stopping import Stopping
from grainmotion.tracking.few_grains import freed, merged, placed_among, with_neighbours

ROWS = np.array([3, 13, 20])


@pytest.fixture(scope="module")
def problem():
    grains, views = many.block(3), many.views(3)
    scan, _ = many.state(grains, views)
    return StateProblem(GrainArrays.of(grains), Target(scan, np.zeros(scan.line_integrals.shape), "trilinear", 0.7))


def test_cost_and_gradient_are_those_of_all_grains(problem):
    pose = many.still(27)
    part, at = freed(problem, pose, ROWS)
    some, whole = part.linearize(at), problem.linearize(pose)
    assert some.cost == pytest.approx(whole.cost, rel=1e-5)
    gradient = whole.gradient.reshape(-1, 6)[ROWS].ravel()
    np.testing.assert_allclose(some.gradient, gradient, atol=1e-4 * np.abs(gradient).max())


def test_displaced_grains_come_back_to_where_all_together_would_be(problem):
    together = gauss_newton(problem, many.still(27), Stopping(iterations=10, step=1e-4)).state
    translations = together.translations.copy()
    translations[ROWS] += 0.8 * many.VOXEL
    start = Pose(translations, together.matrices)
    part, at = freed(problem, start, ROWS)
    end = placed_among(problem, start, gauss_newton(part, at, Stopping(iterations=20, step=1e-4)), ROWS)
    np.testing.assert_allclose(end.state.translations, together.translations, atol=0.02 * many.VOXEL)
    others = np.setdiff1d(np.arange(27), ROWS)
    np.testing.assert_array_equal(end.state.translations[others], together.translations[others])
    assert not end.last_step.reshape(-1, 6)[others].any()
    assert end.costs[-1] == problem.cost(end.state)


def test_merged_poses_keep_the_others():
    pose, some = many.still(27), Pose(np.ones((3, 3)), np.tile(-np.eye(3), (3, 1, 1)))
    both = merged(pose, some, ROWS)
    assert (both.translations.sum(axis=1) == 3 * np.isin(np.arange(27), ROWS)).all()
    assert not pose.translations.any()


def test_neighbours_are_those_within_reach(problem):
    middle = np.array([13])
    near = with_neighbours(problem, many.still(27), middle)
    distances = np.linalg.norm(problem.grains.centers - problem.grains.centers[13], axis=1)
    assert 13 in near
    assert len(near) > 1
    assert distances[near].max() < distances[np.setdiff1d(np.arange(27), near)].min()
