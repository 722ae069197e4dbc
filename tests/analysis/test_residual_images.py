"""Residual images (`analysis.residual_images`): measured minus simulated, with all fitted parameters of the state."""

from dataclasses import replace

import numpy as np
import pytest

from few_grains import VOXEL, geometry, grain_set, small_motions
from grainmotion.analysis.residual_images import residual_images
from grainmotion.model.detector_response import Response
from grainmotion.model.grains import GrainSet
from grainmotion.model.pose import NuisanceMotion, ViewCorrections
from grainmotion.model.scan import Scan
from grainmotion.model.state_fit import StateFit
from grainmotion.model.volume import Volume
from grainmotion.objective.nuisance_motions import corrected_geometry
from grainmotion.projection.grains import simulate_radiographs
from scenes import image_of, moved_body, one_body

GRAINS = grain_set(3, finer=1)
TRUTH = small_motions(GRAINS)
RNG = np.random.default_rng(0)
CORRECTIONS = RNG.normal(size=(4, 3)) * [0.5, 0.5, 0.01]
BACKGROUND = np.array([0.2, -0.1, 0.05, 0.02, -0.05, 0.1])
RESPONSE = Response(np.stack([[0.9, 1.0, 1.1, 1.2], [-0.05] * 4], axis=1), RNG.normal(size=(4, 3)) * 0.05)
NOISE = 0.02 * RNG.standard_normal((4, 52, 64)).astype(np.float32)


def wall():
    """A plate beside the grains."""
    array = np.zeros((40, 50, 50), np.float32)
    array[5:35, 10:40, 44:47] = 0.6
    return Volume(array, VOXEL)


def fitted(**fit):
    return replace(TRUTH, fit=StateFit(**fit))


class TestResidualImages:
    def test_gain_and_offset(self):
        images = 1.1 * simulate_radiographs(GRAINS, TRUTH, geometry()) + 0.03
        residual = residual_images(GRAINS, fitted(gain=1.1, offset=0.03), Scan(images + NOISE, geometry()))
        np.testing.assert_allclose(residual, NOISE, atol=1e-5)

    def test_all_parameters_together(self):
        """Gain, background and hardening of each view, corrected views, and a moved wall."""
        at = replace(NuisanceMotion.still(len(CORRECTIONS)), views=ViewCorrections.of(CORRECTIONS))
        views = corrected_geometry(geometry(), at)
        path = simulate_radiographs(GRAINS, TRUTH, views)
        path += image_of(wall(), views, BACKGROUND)
        scan = Scan(RESPONSE.apply(path) + NOISE, geometry())
        grains = GrainSet(GRAINS.grains, one_body(wall(), True))
        motions = fitted(
            response=RESPONSE, view_corrections=ViewCorrections.of(CORRECTIONS), bodies=(moved_body(BACKGROUND),)
        )
        np.testing.assert_allclose(residual_images(grains, motions, scan), NOISE, atol=1e-5)
        for name, other in (("response", None), ("view_corrections", None), ("bodies", ())):
            worse = replace(motions, fit=replace(motions.fit, **{name: other}))
            assert np.abs(residual_images(grains, worse, scan) - NOISE).max() > 0.05, name

    def test_a_fixed_background(self):
        grains = GrainSet(GRAINS.grains, one_body(wall()))
        scan = Scan(simulate_radiographs(grains, TRUTH, geometry()) + NOISE, geometry())
        np.testing.assert_allclose(residual_images(grains, TRUTH, scan), NOISE, atol=1e-4)

    def test_masked_pixels_are_nan(self):
        valid = np.random.default_rng(1).uniform(size=NOISE.shape) > 0.1
        scan = Scan(np.where(valid, simulate_radiographs(GRAINS, TRUTH, geometry()), 9), geometry(), valid)
        residual = residual_images(GRAINS, TRUTH, scan)
        np.testing.assert_array_equal(np.isnan(residual), ~valid)
        assert np.nanmax(np.abs(residual)) < 1e-5

    def test_grains_without_a_motion_are_not_subtracted(self):
        scan = Scan(simulate_radiographs(GRAINS, TRUTH, geometry()), geometry())
        without_motion = replace(TRUTH, translations=np.where([[False], [True], [False]], np.nan, TRUTH.translations))
        alone = GRAINS.without([0, 2])
        own_motion = replace(
            TRUTH, labels=TRUTH.labels[1:2], centers=TRUTH.centers[1:2], translations=TRUTH.translations[1:2],
            rotations=TRUTH.rotations[1:2], covariances=TRUTH.covariances[1:2], statuses=TRUTH.statuses[1:2],
            residuals=TRUTH.residuals[1:2], iterations=TRUTH.iterations[1:2], reasons=("",),
        )  # fmt: skip
        expected = simulate_radiographs(alone, own_motion, geometry())
        np.testing.assert_allclose(residual_images(GRAINS, without_motion, scan), expected, atol=1e-5)

    @pytest.mark.parametrize("projector", ["trilinear", "exact"])
    def test_residual_is_zero_for_both_projectors(self, projector):
        scan = Scan(simulate_radiographs(GRAINS, TRUTH, geometry(), projector=projector), geometry())
        np.testing.assert_allclose(residual_images(GRAINS, TRUTH, scan, projector=projector), 0, atol=1e-6)

    def test_the_scan_is_not_changed(self):
        valid = np.random.default_rng(1).uniform(size=NOISE.shape) > 0.1
        scan = Scan(np.abs(NOISE), geometry(), valid)
        before = scan.line_integrals.copy()
        residual_images(GRAINS, TRUTH, scan)
        np.testing.assert_array_equal(scan.line_integrals, before)
