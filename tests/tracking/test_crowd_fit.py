"""The fit of a large sample of which some grains are left out (`tracking.crowd_fit`)."""

import numpy as np
import pytest

import many_small_grains as many
from grainmotion.tracking.attempt import Approach, Job
from grainmotion.tracking.crowd_fit import CrowdFit
from grainmotion.tracking.settings import TrackSettings

GONE = np.array([31, 93])


@pytest.fixture(scope="module")
def sample():
    """125 grains in their true places, two of them not on the radiographs."""
    grains = many.block(5)
    scan, _ = many.state(grains.without(GONE.tolist()), many.views(5))
    _, pose = many.state(grains, many.views(5))
    _, fewer = many.state(grains.without(GONE.tolist()), many.views(5))
    kept = np.delete(np.arange(len(grains)), GONE)
    pose.translations[kept], pose.matrices[kept] = fewer.translations, fewer.matrices
    return Job(grains, scan, None, TrackSettings(), None, None), pose


@pytest.fixture
def crowd(sample):
    job, pose = sample
    fit = job.fit()
    problem, solution = fit.solve_few(pose, np.array([0]), "one", 0.01)
    return CrowdFit.of(job, Approach(fit, pose, [], problem, solution, np.zeros(len(job.grains), dtype=bool)))


def left_out(crowd, rows):
    crowd.leave_out(np.isin(np.arange(len(crowd.out)), rows))


def test_grains_left_out_are_not_simulated(crowd):
    whole = crowd.problem.cost(crowd.own_pose)
    left_out(crowd, GONE)
    assert len(crowd.problem.grains) == len(crowd.rows) == 123
    assert crowd.problem.cost(crowd.own_pose) < 0.1 * whole
    left_out(crowd, [])
    assert crowd.problem.cost(crowd.own_pose) == pytest.approx(whole, rel=1e-5)


def test_amplitudes_tell_whose_shadow_is_there(crowd):
    rows = np.array([31, 50, 93])
    left_out(crowd, rows)
    found = crowd.amplitudes(rows, crowd.expected_pose(rows))
    np.testing.assert_allclose(found, [0, 1, 0], atol=0.15)


def test_affected_grains_come_back_and_no_others_move(crowd):
    left_out(crowd, GONE)
    before = crowd.pose
    displaced = before.translations.copy()
    displaced[40] += 0.8 * many.VOXEL
    crowd.take(np.arange(125), before.moved(displaced, before.matrices))
    crowd.solve(np.isin(np.arange(125), [40]), "around it")
    np.testing.assert_allclose(crowd.pose.translations[40], before.translations[40], atol=0.03 * many.VOXEL)
    others = np.delete(np.arange(125), [40])
    np.testing.assert_array_equal(crowd.pose.translations[others], before.translations[others])


def test_misfits_are_of_the_grains_that_are_not_left_out(crowd):
    left_out(crowd, GONE)
    fits, bad = crowd.misfits()
    assert len(fits.shares) == 123
    assert not bad.any()
    assert bad.shape == (125,)
