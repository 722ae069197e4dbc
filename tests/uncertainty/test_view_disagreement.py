"""Factors on variances by what the views ask of the grains (`uncertainty.view_disagreement`)."""

from dataclasses import replace

import numpy as np
import pytest

from classified_poses import pose_of, problem_of, shared_grains, shared_truth
from few_grains import radiographs
from grainmotion.objective.normal_matrix import normal_matrix
from grainmotion.solvers.gauss_newton import gauss_newton
from grainmotion.solvers.stopping import Stopping
from grainmotion.uncertainty.covariance import covariances
from grainmotion.uncertainty.view_disagreement import Disagreement


def standard_deviations(scan):
    """Those of all grains at their best poses, ``(n, 6)``."""
    problem = problem_of(scan)
    pose = gauss_newton(problem, pose_of(shared_truth()), Stopping(20, 1e-4)).state
    evaluation = problem.evaluate_with_derivatives(pose)
    own, _ = covariances(problem, pose, evaluation, normal_matrix(evaluation.jacobian))
    return np.sqrt(np.diagonal(own, axis1=1, axis2=2))


@pytest.fixture(scope="module")
def clean():
    return radiographs(shared_grains(), shared_truth(), noise=0.02)


def test_one_view_out_of_place_raises_the_standard_deviations(clean):
    shifted = clean.line_integrals.copy()
    shifted[1] = np.roll(shifted[1], 1, axis=1)
    sd = standard_deviations(clean)
    disturbed = standard_deviations(replace(clean, line_integrals=shifted))
    assert np.median(disturbed[:, :3] / sd[:, :3]) > 3


def test_a_blurred_panel_raises_them_less_than_its_residual_would(clean):
    """What all views share hardly moves a grain: the scores know it, the residual alone does not."""
    images = clean.line_integrals
    blurred = images + 0.05 * (np.roll(images, 1, axis=1) + np.roll(images, -1, axis=1) - 2 * images)
    ratio = standard_deviations(replace(clean, line_integrals=blurred)) / standard_deviations(clean)
    assert 0.9 < np.median(ratio) < 2


def test_noise_alone_needs_no_factor():
    rng = np.random.default_rng(0)
    expected = np.full((2000, 2), 6.0)
    found = rng.chisquare(6, size=(2000, 2))
    factors = Disagreement(found, expected, expected).factors(np.ones(2000, dtype=bool))
    assert 1 <= factors.min() < 1.05
    assert factors.mean() < 1.1


def test_a_disagreement_beyond_noise_is_the_factor_and_grains_not_trusted_have_their_own():
    expected = np.full((40, 2), 6.0)
    found = np.tile([24.0, 12.0], (40, 1))
    found[0] = 6000.0
    factors = Disagreement(found, expected, 0.5 * expected).factors(np.arange(40) > 0)
    np.testing.assert_allclose(factors[1:], [[4.5, 2.5]] * 39, rtol=0.1)  # 1 + (24 - 3) / 6, 1 + (12 - 3) / 6
    assert factors[0].min() > 100


def test_one_view_shows_no_disagreement():
    factors = Disagreement(np.zeros((3, 2)), np.zeros((3, 2)), np.zeros((3, 2))).factors(np.ones(3, dtype=bool))
    np.testing.assert_array_equal(factors, 1.0)
