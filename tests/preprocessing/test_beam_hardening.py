"""Beam-hardening correction (`preprocessing.beam_hardening`), against monochromatic line integrals."""

import dataclasses

import numpy as np
import pytest

from grainmotion.errors import InputError
from grainmotion.model.scan import Scan
from grainmotion.model.volume import Volume
from grainmotion.preprocessing.beam_hardening import Hardening, HardeningSettings, calibrate_hardening
from grainmotion.reconstruction.reconstruct import ReconstructSettings, reconstruct
from grainmotion.segmentation.segment import segment
from grainmotion.simulate import scenarios
from grainmotion.simulate.detector import record_line_integrals
from grainmotion.simulate.radiograph import line_integrals

SHARES = ((0.25, 0.55), (0.35, 0.9), (0.25, 1.3), (0.15, 1.9))
MEAN = sum(share * ratio for share, ratio in SHARES)
SPECTRUM = tuple((share, ratio / MEAN) for share, ratio in SHARES)
MONOCHROMATIC = ((1.0, 1.0),)
EQUAL_ATTENUATIONS = (0.4,) * 6
DIFFERENT_ATTENUATIONS = (0.25, 0.55, 0.4, 0.3, 0.5, 0.45)  # 1/mm


@pytest.fixture(scope="module")
def case():
    return scenarios.small()


def measured(case, attenuations, spectrum):
    """Scan with noise, its reconstruction, and line integrals without noise: of this spectrum and monochromatic."""
    particles = zip(case.sample.particles, attenuations, strict=True)
    particles = tuple(dataclasses.replace(p, attenuation=a) for p, a in particles)
    sample = dataclasses.replace(case.sample, particles=particles)
    views = case.scanner.geometry()
    scan = record_line_integrals(sample, views, dataclasses.replace(case.physics, spectrum=spectrum), 1)
    volume = reconstruct(scan, case.scanner.grid, ReconstructSettings(sweeps=2, hardening=False)).volume
    return scan, volume, line_integrals(sample, views, spectrum=spectrum), line_integrals(sample, views)


def error(images, truth):
    return np.linalg.norm(images - truth) / np.linalg.norm(truth)


class TestGrainsOfOneMaterial:
    def test_corrected_line_integrals_are_close_to_monochromatic_ones(self, case):
        scan, volume, hard, mono = measured(case, EQUAL_ATTENUATIONS, SPECTRUM)
        curve = calibrate_hardening(scan, volume)
        assert not curve.is_linear
        assert curve.departure == pytest.approx(0.15, abs=0.03)
        assert error(hard, mono) > 0.09
        assert error(curve(hard), mono) < 0.015

    def test_a_monochromatic_scan_is_not_corrected(self, case):
        scan, volume, _, _ = measured(case, EQUAL_ATTENUATIONS, MONOCHROMATIC)
        curve = calibrate_hardening(scan, volume)
        assert curve.is_linear
        assert curve.apply(scan) is scan


class TestGrainsOfDifferentMaterials:
    """Connected voxels above the threshold are of several materials, which labels separate."""

    def test_corrected_line_integrals_are_close_to_monochromatic_ones(self, case):
        scan, volume, hard, mono = measured(case, DIFFERENT_ATTENUATIONS, SPECTRUM)
        curve = calibrate_hardening(scan, volume, labels=segment(volume).labels)
        assert error(curve(hard), mono) < 0.5 * error(hard, mono)

    def test_a_monochromatic_scan_is_not_corrected(self, case):
        scan, volume, _, _ = measured(case, DIFFERENT_ATTENUATIONS, MONOCHROMATIC)
        assert calibrate_hardening(scan, volume, labels=segment(volume).labels).is_linear


class TestCurve:
    def test_small_line_integrals_are_unchanged(self):
        curve = Hardening((1.0, 0.1, 0.02), 2.0)
        np.testing.assert_allclose(curve(np.array([1e-6, 1.0, 2.0])), [1e-6, 1.12, 2.56], rtol=1e-6)
        assert curve.departure == pytest.approx(0.28)

    def test_curve_is_monotone_and_leaves_negative_values(self):
        b = np.linspace(-0.1, 5, 500)
        g = Hardening((1.0, 0.1, 0.02), 2.0)(b)
        assert (np.diff(g) > 0).all()
        np.testing.assert_array_equal(g[b < 0], b[b < 0])

    def test_precision_and_mask_are_kept(self, case):
        views = case.scanner.geometry((0.0, 90.0))
        images = np.ones((2, *views.shape), np.float32)
        scan = Scan(images, views, images > 0)
        corrected = Hardening((1.0, 0.5), 1.0).apply(scan)
        assert corrected.line_integrals.dtype == np.float32
        assert corrected.valid is scan.valid
        np.testing.assert_allclose(corrected.line_integrals, 1.5)

    @pytest.mark.parametrize("coefficients", [(), (2.0,), (1.0, -0.1), (1.0, np.nan)])
    def test_invalid_coefficients_are_refused(self, coefficients):
        with pytest.raises(InputError, match="coefficients"):
            Hardening(coefficients)


class TestInput:
    def test_a_threshold_above_all_voxels_is_refused(self, case):
        scan = case.reference().select(slice(0, 16))
        rng = np.random.default_rng(0)
        volume = Volume(rng.random((8, 8, 8)), 1.0)
        with pytest.raises(InputError, match="no voxel above"):
            calibrate_hardening(scan, volume, settings=HardeningSettings(threshold=2.0))

    def test_a_uniform_volume_is_refused(self, case):
        with pytest.raises(InputError, match="uniform"):
            calibrate_hardening(case.reference().select(slice(0, 16)), case.scanner.grid)

    def test_two_views_are_refused(self, case):
        with pytest.raises(InputError, match="2 views"):
            calibrate_hardening(case.reference().select([0, 1]), case.scanner.grid)

    def test_labels_of_another_shape_are_refused(self, case):
        volume = Volume(np.random.default_rng(0).random((8, 8, 8)), 0.1)
        scan = case.reference().select(slice(0, 16))
        with pytest.raises(InputError, match="labels of"):
            calibrate_hardening(scan, volume, labels=np.ones((4, 4, 4), int))
