"""Which grains fit badly."""

from dataclasses import replace

import numpy as np
import pytest

from grainmotion.model.pose import Pose
from grainmotion.objective.residual import StateProblem
from grainmotion.uncertainty.goodness_of_fit import Misfits, misfits
from textured_lumps import GRAINS, POSE, mask, measured, target


class TestCrowds:
    """Grains one behind the other."""

    def test_line_integrals_of_a_crowd_add_up_in_squares(self):
        one, nine = (misfits(problem := crowd(k), problem.evaluate(still(k))) for k in (1, 9))
        np.testing.assert_allclose(one.rms_crowd_integrals, one.rms_line_integrals, rtol=1e-5)
        np.testing.assert_allclose(nine.rms_line_integrals, one.rms_line_integrals[0], rtol=1e-5)
        np.testing.assert_allclose(nine.rms_crowd_integrals, 3 * one.rms_line_integrals[0], rtol=1e-5)

    @pytest.mark.parametrize(("many", "share"), [(1, 0.04), (30, 0.04 * np.sqrt(30))])
    def test_what_all_of_them_leave_accuses_none(self, many, share):
        """Each leaves 4 % of its line integrals, as grains of voxels do."""
        crowds = np.full(many, np.sqrt(many))
        assert not Misfits(np.full(many, share), np.ones(many), crowds, 0.0).misregistered.any()

    def test_one_in_a_wrong_place_stands_out_of_them(self):
        residuals = 0.03 * np.sqrt(30) * np.ones(30)
        residuals[7] = np.hypot(residuals[7], 0.25)
        lost = Misfits(residuals, np.ones(30), np.full(30, np.sqrt(30)), 0.0).misregistered
        np.testing.assert_array_equal(np.flatnonzero(lost), [7])

    def test_all_in_wrong_places_are_all_lost(self):
        found = Misfits(np.full(30, 0.25 * np.sqrt(30)), np.ones(30), np.full(30, np.sqrt(30)), 0.0)
        assert found.misregistered.all()
        assert found.misregistered_in_crowd.all()

    def test_near_is_not_astray(self):
        """Half-way through, each of 30 leaves 9 %: all together look lost, but none is far."""
        found = Misfits(np.full(30, 0.09 * np.sqrt(30)), np.ones(30), np.full(30, np.sqrt(30)), 0.0)
        assert found.misregistered.all()
        assert not found.misregistered_in_crowd.any()


def still(many):
    """No motion of so many grains."""
    return Pose(np.zeros((many, 3)), np.broadcast_to(np.eye(3), (many, 3, 3)).copy())


def crowd(many):
    """The same grain, so many times in the same place."""
    return StateProblem(GRAINS.select([1] * many), target())


class TestMisfits:
    def test_planted_misfit_of_one_grain(self):
        pose = replace(POSE, translations=POSE.translations.copy())
        pose.translations[3] += [0.2, 0.1, -0.15]
        problem = StateProblem(GRAINS, target(images=measured(noise=1e-4)))
        found = misfits(problem, problem.evaluate_with_derivatives(pose))
        assert found.rms_residuals[3] > 20 * found.rms_residuals[:3].max()
        assert (found.rms_line_integrals > 0.3).all()
        np.testing.assert_array_equal(found.misregistered, [False, False, False, True])

    def test_even_misfit(self):
        problem = StateProblem(GRAINS, target(images=measured(offset=0.07)))
        np.testing.assert_allclose(
            misfits(problem, problem.evaluate_with_derivatives(POSE)).rms_residuals, 0.07, rtol=1e-3
        )

    def test_masked_pixels_do_not_count(self):
        valid = mask()
        images = np.where(valid, measured(), 1e4).astype(np.float32)
        problem = StateProblem(GRAINS, target(valid=valid, images=images))
        assert misfits(problem, problem.evaluate_with_derivatives(POSE)).rms_residuals.max() < 1e-5

    def test_noise_is_no_misfit(self):
        assert not alone([0.02, 0.021, 0.019, 0.022], 0.02).misregistered.any()

    def test_unknown_is_a_misfit(self):
        np.testing.assert_array_equal(alone([0.02, np.nan], 0.02).misregistered, [False, True])

    def test_all_bad_is_seen_by_the_noise(self):
        """When every grain fits badly, none stands out from the others; the noise tells."""
        assert alone([0.2] * 5, 0.02).misregistered.all()

    def test_thin_shadows_in_strong_noise_do_not_accuse(self):
        assert not alone([0.05], 0.03).misregistered.any()


def alone(residuals, noise):
    """Grains on rays of their own."""
    paths = np.where(np.isfinite(residuals), 1.0, np.nan)
    return Misfits(np.array(residuals), paths, paths, noise)
