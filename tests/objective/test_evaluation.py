"""Evaluating a pose (`objective.residual`): gain and offset, and radiographs without a visible grain or valid pixel."""

from dataclasses import replace

import numpy as np
import pytest

from few_grains import GAIN_AND_OFFSET
from grainmotion.model.scan import Scan
from grainmotion.objective.data_term import Target
from grainmotion.objective.global_parameters import Columns
from grainmotion.objective.residual import StateProblem
from grainmotion.objective.response_parameters import fit_response
from grainmotion.uncertainty.goodness_of_fit import misfits
from textured_lumps import GEOMETRY, GRAINS, PANEL, POSE, mask, measured, target


class TestNothingVisible:
    """No grain is visible or no pixel valid: derivatives are zero, and nothing is raised."""

    @pytest.mark.parametrize("gain", [False, True])
    def test_all_grains_off_the_panel(self, gain):
        away = replace(POSE, translations=POSE.translations + np.array([0, 0, 1e3]))
        problem = StateProblem(GRAINS, target(1.0, gain))
        at = problem.linearize(away)
        assert np.isfinite(at.cost)
        assert not at.gradient.any()
        assert at.hessian.nnz == 0
        evaluation = problem.evaluate_with_derivatives(away)
        assert (evaluation.response.gain, evaluation.response.offset) == (1.0, 0.0)
        assert misfits(problem, evaluation).misregistered.all()

    @pytest.mark.parametrize("gain", [False, True])
    def test_without_a_valid_pixel(self, gain):
        problem = StateProblem(GRAINS, target(1.0, gain, np.zeros((3, *PANEL), bool)))
        at = problem.linearize(POSE)
        assert at.cost == 0
        assert not at.gradient.any()
        assert misfits(problem, problem.evaluate_with_derivatives(POSE)).misregistered.all()

    def test_a_masked_view_does_not_count(self):
        valid = np.ones((3, *PANEL), bool)
        valid[1] = False
        at = StateProblem(GRAINS, target(1.0, valid=valid)).linearize(POSE)
        two = Scan(measured(noise=0.02)[[0, 2]], GEOMETRY[[0, 2]])
        other = Target(two, np.zeros((2, *PANEL), np.float32), "trilinear", 1.0)
        expected = StateProblem(GRAINS, other).linearize(POSE)
        assert at.cost == pytest.approx(expected.cost, rel=1e-6)
        np.testing.assert_allclose(at.gradient, expected.gradient, rtol=1e-5, atol=1e-4)


class TestGain:
    @pytest.mark.parametrize(("gain", "offset"), [(1.0, 0.0), (1.1, 0.0), (0.9, 0.05), (1.3, -0.2)])
    @pytest.mark.parametrize("sigma", [0.0, 2.0])
    def test_simulated_gain_and_offset_are_estimated(self, gain, offset, sigma):
        problem = StateProblem(GRAINS, target(sigma, True, mask(), measured(gain, offset)))
        evaluation = problem.evaluate_with_derivatives(POSE)
        assert evaluation.response.gain == pytest.approx(gain, abs=1e-5)
        assert evaluation.response.offset == pytest.approx(offset, abs=1e-5)
        assert problem.linearize(POSE).cost < 1e-6

    def test_response_to_degenerate_images(self):
        """Without a simulated image nothing is fitted; a uniform one is, though gain and offset are not unique."""
        ones = np.ones((1, 4, 4), np.float32)
        identity, _, _ = fit_response(GAIN_AND_OFFSET, Columns([0 * ones, ones], [True, True]), 3 * ones, 1)
        assert (identity.gain, identity.offset) == (1.0, 0.0)
        uniform, fitted, _ = fit_response(GAIN_AND_OFFSET, Columns([2 * ones, ones], [True, True]), ones, 1)
        np.testing.assert_allclose(fitted, ones, rtol=1e-6)
        assert np.isfinite([uniform.gain, uniform.offset]).all()

    def test_eliminating_gain_and_offset_lowers_the_cost(self):
        images = measured(1.07, 0.02, 0.05)
        with_gain = StateProblem(GRAINS, target(1.0, True, images=images)).linearize(POSE).cost
        without = StateProblem(GRAINS, target(1.0, False, images=images)).linearize(POSE).cost
        assert with_gain < without
