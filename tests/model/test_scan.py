"""Scan (`model.scan`): attenuation of air and signal-to-noise ratio."""

import numpy as np
import pytest

from grainmotion.errors import InputError
from grainmotion.model.geometry import Geometry
from grainmotion.model.scan import Scan, air_levels, normalize_air, snr

SHAPE = (7, 9)


def parallel(views, shape=SHAPE):
    return Geometry.parallel(np.arange(views) * 10.0, shape, 0.1)


class TestAir:
    def scan(self):
        images = np.ones((3, *SHAPE), np.float32)
        images[:, :, :2] = images[:, :, -2:] = 0.0
        return Scan(images + np.array([0.34, -0.1, 0.0], np.float32)[:, None, None], parallel(3))

    @pytest.mark.parametrize("choice", [{"margin": 2}, {"region": (0, 7, 0, 2)}])
    def test_beam_factor_of_each_view_is_removed(self, choice):
        scan = self.scan()
        np.testing.assert_allclose(air_levels(scan, **choice), [0.34, -0.1, 0.0], atol=1e-6)
        flat = normalize_air(scan, **choice)
        np.testing.assert_allclose(flat.line_integrals[:, 3, 4], 1.0, atol=1e-6)

    def test_masked_pixels_do_not_count(self):
        scan = self.scan()
        valid = np.ones(scan.line_integrals.shape, bool)
        valid[:, :, 0] = False
        images = scan.line_integrals.copy()
        images[:, :, 0] = 50.0
        masked = Scan(images, scan.geometry, valid)
        np.testing.assert_allclose(air_levels(masked, region=(0, 7, 0, 2)), [0.34, -0.1, 0.0], atol=1e-6)
        assert normalize_air(masked, margin=2).valid is valid

    @pytest.mark.parametrize(
        "choice", [{}, {"margin": 2, "region": (0, 1, 0, 1)}, {"margin": 5}, {"region": (0, 8, 0, 2)}]
    )
    def test_no_two_or_impossible_regions_are_refused(self, choice):
        with pytest.raises(InputError):
            normalize_air(self.scan(), **choice)


class TestSnr:
    def test_snr_of_given_noise(self):
        rng = np.random.default_rng(1)
        signal = np.ones((4, 60, 60))
        geometry = parallel(4, (60, 60))
        a, b = (Scan(signal + rng.normal(0, 0.02, signal.shape), geometry) for _ in range(2))
        assert snr(a, b) == pytest.approx(50, rel=0.03)

    def test_snr_without_noise_is_infinite(self):
        scan = Scan(np.ones((1, *SHAPE)), parallel(1))
        assert snr(scan, scan) == float("inf")

    def test_scans_of_different_shapes_are_refused(self):
        with pytest.raises(InputError, match="differ"):
            snr(Scan(np.ones((1, *SHAPE)), parallel(1)), Scan(np.ones((2, *SHAPE)), parallel(2)))
