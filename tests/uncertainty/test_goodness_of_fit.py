"""Goodness of fit (`uncertainty.goodness_of_fit`): which grains are misregistered."""

from dataclasses import replace

import numpy as np
import pytest

from grainmotion.model.pose import Pose
from grainmotion.objective.residual import StateProblem
from grainmotion.uncertainty.goodness_of_fit import Misfits, misfits
from textured_lumps import GRAINS, POSE, mask, measured, target


class TestOverlappingGrains:
    """Grains whose projections overlap."""

    def test_squared_line_integrals_of_overlapping_grains_add_up(self):
        one, nine = (misfits(problem := crowd(k), problem.evaluate(still(k))) for k in (1, 9))
        np.testing.assert_allclose(one.rms_crowd_integrals, one.rms_line_integrals, rtol=1e-5)
        np.testing.assert_allclose(nine.rms_line_integrals, one.rms_line_integrals[0], rtol=1e-5)
        np.testing.assert_allclose(nine.rms_crowd_integrals, 3 * one.rms_line_integrals[0], rtol=1e-5)

    @pytest.mark.parametrize(("many", "share"), [(1, 0.04), (30, 0.04 * np.sqrt(30))])
    def test_equal_small_residuals_of_all_grains_are_no_misregistration(self, many, share):
        """The residual of each is 4 % of its line integrals, as for grains of voxels."""
        crowds = np.full(many, np.sqrt(many))
        assert not Misfits(np.full(many, share), np.ones(many), crowds, 0.0).misregistered.any()

    def test_a_misregistered_grain_is_detected_among_overlapping_ones(self):
        residuals = 0.03 * np.sqrt(30) * np.ones(30)
        residuals[7] = np.hypot(residuals[7], 0.25)
        misregistered = Misfits(residuals, np.ones(30), np.full(30, np.sqrt(30)), 0.0).misregistered
        np.testing.assert_array_equal(np.flatnonzero(misregistered), [7])

    def test_all_grains_may_be_misregistered(self):
        fit = Misfits(np.full(30, 0.25 * np.sqrt(30)), np.ones(30), np.full(30, np.sqrt(30)), 0.0)
        assert fit.misregistered.all()
        assert fit.misregistered_in_crowd.all()

    def test_grains_close_to_their_places_are_not_misregistered_in_the_crowd(self):
        """During a fit each of 30 grains has a residual of 9 %: all count as misregistered, but none is far off."""
        fit = Misfits(np.full(30, 0.09 * np.sqrt(30)), np.ones(30), np.full(30, np.sqrt(30)), 0.0)
        assert fit.misregistered.all()
        assert not fit.misregistered_in_crowd.any()


def still(many):
    """The pose of unmoved grains."""
    return Pose(np.zeros((many, 3)), np.broadcast_to(np.eye(3), (many, 3, 3)).copy())


def crowd(many):
    """Copies of one grain in the same place."""
    return StateProblem(GRAINS.select([1] * many), target())


class TestMisfits:
    def test_a_displaced_grain_is_misregistered(self):
        pose = replace(POSE, translations=POSE.translations.copy())
        pose.translations[3] += [0.2, 0.1, -0.15]
        problem = StateProblem(GRAINS, target(images=measured(noise=1e-4)))
        fit = misfits(problem, problem.evaluate_with_derivatives(pose))
        assert fit.rms_residuals[3] > 20 * fit.rms_residuals[:3].max()
        assert (fit.rms_line_integrals > 0.3).all()
        np.testing.assert_array_equal(fit.misregistered, [False, False, False, True])

    def test_a_uniform_offset_is_the_residual_of_every_grain(self):
        problem = StateProblem(GRAINS, target(images=measured(offset=0.07)))
        np.testing.assert_allclose(
            misfits(problem, problem.evaluate_with_derivatives(POSE)).rms_residuals, 0.07, rtol=1e-3
        )

    def test_masked_pixels_do_not_count(self):
        valid = mask()
        images = np.where(valid, measured(), 1e4).astype(np.float32)
        problem = StateProblem(GRAINS, target(valid=valid, images=images))
        assert misfits(problem, problem.evaluate_with_derivatives(POSE)).rms_residuals.max() < 1e-5

    def test_residuals_of_the_noise_s_size_are_no_misregistration(self):
        assert not alone([0.02, 0.021, 0.019, 0.022], 0.02).misregistered.any()

    def test_a_nan_residual_is_a_misregistration(self):
        np.testing.assert_array_equal(alone([0.02, np.nan], 0.02).misregistered, [False, True])

    def test_grains_that_all_fit_badly_are_detected_by_the_noise(self):
        """When every grain fits badly, none stands out from the others; residuals are compared with the noise."""
        assert alone([0.2] * 5, 0.02).misregistered.all()

    def test_a_large_residual_in_strong_noise_is_no_misregistration(self):
        assert not alone([0.05], 0.03).misregistered.any()

    def test_noise_that_exceeds_its_mean_by_chance_is_no_misregistration(self):
        """As of grains little denser than the liquid around them: noise is a third of their line integrals."""
        others = [0.34] * 8
        fit = replace(alone([0.36, 0.45, *others], 0.34), noise_spread=np.full(10, 0.04))
        np.testing.assert_array_equal(fit.misregistered, [False, True, *[False] * 8])
        assert alone([0.36, *others], 0.34).misregistered[0]  # of as many pixels as to leave no chance

    def test_noise_is_that_of_each_grain_s_own_pixels(self):
        problem = StateProblem(GRAINS, target())
        path = problem.evaluate(POSE).line_integrals
        noise = 0.02 * np.exp(path / 2) * np.random.default_rng(0).normal(size=path.shape)
        noisy = StateProblem(GRAINS, target(images=(path + noise).astype(np.float32)))
        fit = misfits(noisy, noisy.evaluate(POSE))
        np.testing.assert_allclose(fit.noise, fit.rms_residuals, rtol=0.25)
        assert not fit.misregistered.any()


def alone(residuals, noise):
    """Goodness of fit of grains that overlap with no others."""
    line_integrals = np.where(np.isfinite(residuals), 1.0, np.nan)
    return Misfits(np.array(residuals), line_integrals, line_integrals, noise)
