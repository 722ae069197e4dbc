"""Statuses and sentences: what is said of each grain is true."""

from dataclasses import replace

import numpy as np
import pytest

from classified_poses import GRAINS, TRUTH, classified, pose_of
from few_grains import PANEL, VOXEL, grain_set, motions, radiographs
from grainmotion.model.geometry import Geometry
from grainmotion.model.motions import Status


class TestStatuses:
    def test_converged(self):
        found = classified(radiographs(GRAINS, TRUTH), pose_of(TRUTH))
        assert set(found.statuses) == {Status.CONVERGED.value}
        assert set(found.reasons) == {""}
        np.testing.assert_allclose(found.translations, TRUTH.translations)
        np.testing.assert_allclose(found.rotations, TRUTH.rotations, atol=1e-12)
        np.testing.assert_allclose(found.residuals, 0.01, rtol=0.1)
        assert set(found.iterations) == {2}
        assert found.fit.costs == (("free", 0.1), ("free", 0.05))
        assert found.fit.gain == pytest.approx(1, abs=2e-3)

    def test_wrong_place(self):
        """Two voxels off: the residual says so, and keeps the last value."""
        wrong = replace(TRUTH, translations=TRUTH.translations.copy())
        wrong.translations[2] += 2 * VOXEL
        found = classified(radiographs(GRAINS, TRUTH), pose_of(wrong))
        assert found.statuses[2] == Status.NOT_CONVERGED.value
        assert "residual" in found.reasons[2]
        np.testing.assert_allclose(found.translations[2], wrong.translations[2])
        assert found.ok[3:].all()  # what overlaps it may suffer, the others do not

    def test_a_grain_that_another_search_put_elsewhere(self):
        ambiguous = np.arange(5) == 2
        found = classified(radiographs(GRAINS, TRUTH), pose_of(TRUTH), ambiguous=ambiguous)
        np.testing.assert_array_equal(found.statuses == Status.NOT_CONVERGED.value, ambiguous)
        assert "elsewhere" in found.reasons[2]
        np.testing.assert_allclose(found.translations, TRUTH.translations)

    def test_without_any_noise_what_no_view_sees_is_still_unknown(self):
        """A residual of nothing is no proof that the depth in one parallel view is known."""
        views = Geometry.parallel([0.0], PANEL, VOXEL)
        found = classified(radiographs(GRAINS, TRUTH, views=views, noise=0.0), pose_of(TRUTH))
        assert set(found.statuses) == {Status.POORLY_DETERMINED.value}

    def test_few_pixels_for_each_unknown_are_told(self):
        scan = radiographs(GRAINS, TRUTH)
        assert not any("for each unknown" in note for note in classified(scan, pose_of(TRUTH)).fit.notes)
        few = np.zeros(scan.line_integrals.shape, bool)
        few[:, ::6, ::2] = True
        told = classified(replace(scan, valid=few), pose_of(TRUTH)).fit.notes
        assert any("pixels for each unknown are few" in note for note in told)

    def test_still_moving_when_iterations_ran_out(self):
        step = np.zeros(30)
        step[6 * 3] = 0.2 * VOXEL
        step[6 * 1] = 0.05 * VOXEL
        found = classified(radiographs(GRAINS, TRUTH), pose_of(TRUTH), settled=False, last_step=step)
        assert list(found.statuses == Status.NOT_CONVERGED.value) == [False, False, False, True, False]
        assert "track.iterations" in found.reasons[3]
        assert classified(radiographs(GRAINS, TRUTH), pose_of(TRUTH), last_step=step).ok.all()

    def test_turning_still_counts_as_moving(self):
        step = np.zeros(30)
        step[6 * 2 + 5] = 0.05  # radians, 0.3 voxel at the rim
        found = classified(radiographs(GRAINS, TRUTH), pose_of(TRUTH), settled=False, last_step=step)
        assert found.statuses[2] == Status.NOT_CONVERGED.value

    def test_left_field_and_not_fitted(self):
        truth = replace(TRUTH, translations=TRUTH.translations.copy())
        truth.translations[3] += [0, 0, 1.5]
        truth.translations[4] += [0, 0, 30]
        found = classified(radiographs(GRAINS, truth), pose_of(truth))
        assert found.statuses[3] == Status.LEFT_FIELD.value
        assert "of its shadows" in found.reasons[3]
        assert found.statuses[4] == Status.NOT_FITTED.value
        assert np.isnan(found.translations[3:]).all()
        assert np.isnan(found.rotations[3:]).all()
        assert np.isnan(found.covariances[3:]).all()
        assert found.ok[:3].all()

    def test_limits_decide_what_is_poorly_determined(self):
        scan = radiographs(GRAINS, TRUTH)
        found = classified(scan, pose_of(TRUTH), limits=(1e-9, 1.0))
        assert set(found.statuses) == {Status.POORLY_DETERMINED.value}
        assert "translation along any axis" in found.reasons[0]
        assert "rotation" not in found.reasons[0]
        turned = classified(scan, pose_of(TRUTH), limits=(1.0, 1e-9))
        assert "rotation about any axis" in turned.reasons[0]
        np.testing.assert_allclose(turned.translations, TRUTH.translations)  # kept, and marked

    def test_depth_in_one_parallel_view(self):
        grains = grain_set(1)
        truth = motions(grains)
        scan = radiographs(grains, truth, views=Geometry.parallel([0.0], PANEL, VOXEL))
        found = classified(scan, pose_of(truth), grains)
        assert found.statuses[0] == Status.POORLY_DETERMINED.value
        assert "translation along y" in found.reasons[0]
        sd = np.sqrt(np.diagonal(found.covariances[0]))
        assert sd[1] > 10 * max(sd[0], sd[2])  # what the prior leaves of an unknown depth
