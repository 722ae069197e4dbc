"""Classification of grains (`tracking.classification`): statuses, reasons and notes."""

from dataclasses import replace

import numpy as np
import pytest

from classified_poses import classified, pose_of, shared_grains, shared_truth
from few_grains import PANEL, VOXEL, grain_set, motions, radiographs
from grainmotion.model.geometry import Geometry
from grainmotion.model.motions import Status


class TestStatuses:
    def test_the_true_pose_is_converged(self):
        measured = classified(radiographs(shared_grains(), shared_truth()), pose_of(shared_truth()))
        assert set(measured.statuses) == {Status.CONVERGED.value}
        assert set(measured.reasons) == {""}
        np.testing.assert_allclose(measured.translations, shared_truth().translations)
        np.testing.assert_allclose(measured.rotations, shared_truth().rotations, atol=1e-12)
        np.testing.assert_allclose(measured.residuals, 0.01, rtol=0.1)
        assert set(measured.iterations) == {2}
        assert measured.fit.costs == (("free", 0.1), ("free", 0.05))
        assert measured.fit.gain == pytest.approx(1, abs=2e-3)

    def test_a_displaced_grain_is_not_converged(self):
        """Two voxels off: the reason names the residual, and the last value is kept."""
        wrong = replace(shared_truth(), translations=shared_truth().translations.copy())
        wrong.translations[2] += 2 * VOXEL
        measured = classified(radiographs(shared_grains(), shared_truth()), pose_of(wrong))
        assert measured.statuses[2] == Status.NOT_CONVERGED.value
        assert "residual" in measured.reasons[2]
        np.testing.assert_allclose(measured.translations[2], wrong.translations[2])
        assert measured.ok[3:].all()  # grains that overlap it may be affected, the others are not

    def test_an_ambiguous_grain_is_not_converged(self):
        ambiguous = np.arange(5) == 2
        measured = classified(
            radiographs(shared_grains(), shared_truth()), pose_of(shared_truth()), ambiguous=ambiguous
        )
        np.testing.assert_array_equal(measured.statuses == Status.NOT_CONVERGED.value, ambiguous)
        assert "elsewhere" in measured.reasons[2]
        np.testing.assert_allclose(measured.translations, shared_truth().translations)

    def test_an_undetermined_direction_is_reported_without_noise(self):
        """The depth in one parallel view is undetermined even if the residual is zero."""
        views = Geometry.parallel([0.0], PANEL, VOXEL)
        measured = classified(
            radiographs(shared_grains(), shared_truth(), views=views, noise=0.0), pose_of(shared_truth())
        )
        assert set(measured.statuses) == {Status.POORLY_DETERMINED.value}

    def test_few_pixels_for_each_unknown_are_noted(self):
        scan = radiographs(shared_grains(), shared_truth())
        assert not any("for each unknown" in note for note in classified(scan, pose_of(shared_truth())).fit.notes)
        few = np.zeros(scan.line_integrals.shape, bool)
        few[:, ::6, ::2] = True
        notes = classified(replace(scan, valid=few), pose_of(shared_truth())).fit.notes
        assert any("pixels for each unknown are few" in note for note in notes)

    def test_a_large_last_translation_is_not_converged(self):
        step = np.zeros(30)
        step[6 * 3] = 0.2 * VOXEL
        step[6 * 1] = 0.05 * VOXEL
        measured = classified(
            radiographs(shared_grains(), shared_truth()), pose_of(shared_truth()), settled=False, last_step=step
        )
        assert list(measured.statuses == Status.NOT_CONVERGED.value) == [False, False, False, True, False]
        assert "track.iterations" in measured.reasons[3]
        assert classified(
            radiographs(shared_grains(), shared_truth()), pose_of(shared_truth()), last_step=step
        ).ok.all()

    def test_a_large_last_rotation_is_not_converged(self):
        step = np.zeros(30)
        step[6 * 2 + 5] = 0.05  # radians, 0.3 voxel at the surface
        measured = classified(
            radiographs(shared_grains(), shared_truth()), pose_of(shared_truth()), settled=False, last_step=step
        )
        assert measured.statuses[2] == Status.NOT_CONVERGED.value

    def test_left_field_and_not_fitted(self):
        truth = replace(shared_truth(), translations=shared_truth().translations.copy())
        truth.translations[3] += [0, 0, 1.5]
        truth.translations[4] += [0, 0, 30]
        measured = classified(radiographs(shared_grains(), truth), pose_of(truth))
        assert measured.statuses[3] == Status.LEFT_FIELD.value
        assert "of its shadows" in measured.reasons[3]
        assert measured.statuses[4] == Status.NOT_FITTED.value
        assert np.isnan(measured.translations[3:]).all()
        assert np.isnan(measured.rotations[3:]).all()
        assert np.isnan(measured.covariances[3:]).all()
        assert measured.ok[:3].all()

    def test_limits_of_poorly_determined_grains(self):
        scan = radiographs(shared_grains(), shared_truth())
        measured = classified(scan, pose_of(shared_truth()), limits=(1e-9, 1.0))
        assert set(measured.statuses) == {Status.POORLY_DETERMINED.value}
        assert "translation along any axis" in measured.reasons[0]
        assert "rotation" not in measured.reasons[0]
        assert measured.ok_rotation.all()
        assert not measured.ok_translation.any()
        with_rotation_limit = classified(scan, pose_of(shared_truth()), limits=(1.0, 1e-9))
        assert "rotation about any axis" in with_rotation_limit.reasons[0]
        np.testing.assert_allclose(with_rotation_limit.translations, shared_truth().translations)  # kept
        assert with_rotation_limit.ok_translation.all()
        assert not with_rotation_limit.ok_rotation.any()
        assert "the rest is a result to use" in with_rotation_limit.reasons[0]

    def test_depth_in_one_parallel_view(self):
        grains = grain_set(1)
        truth = motions(grains)
        scan = radiographs(grains, truth, views=Geometry.parallel([0.0], PANEL, VOXEL))
        measured = classified(scan, pose_of(truth), grains)
        assert measured.statuses[0] == Status.POORLY_DETERMINED.value
        assert "translation along y" in measured.reasons[0]
        sd = np.sqrt(np.diagonal(measured.covariances[0]))
        assert sd[1] > 10 * max(sd[0], sd[2])  # the standard deviation of the prior
