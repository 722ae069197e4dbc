"""The data term (`objective.data_term`): Gaussian filter and masked pixels."""

from dataclasses import replace

import numpy as np
import pytest

from grainmotion.objective.data_term import gaussian
from textured_lumps import by_scipy, mask, measured, target


class TestFilter:
    @pytest.mark.parametrize("sigma", [0.3, 0.7, 2.0, 6.0, 40.0])
    def test_kernel_is_normalised_and_has_its_width(self, sigma):
        half = gaussian(sigma)
        whole = np.concatenate([half[:0:-1], half]).astype(float)
        assert whole.sum() == pytest.approx(1, abs=1e-6)
        assert (np.diff(half) < 0).all()
        if sigma >= 0.7:
            k = np.arange(len(whole)) - len(half) + 1
            assert np.sqrt((whole * k**2).sum()) == pytest.approx(sigma, rel=0.02)

    def test_sigma_zero_filters_nothing(self):
        np.testing.assert_array_equal(gaussian(0), [1])
        images = measured(noise=0.1)
        np.testing.assert_array_equal(target().filtered(images), images)

    @pytest.mark.parametrize("sigma", [0.5, 2.0, 20.0])  # the last kernel is wider than the panel
    def test_radiographs_are_convolved(self, sigma):
        images = measured(noise=0.1)
        images[1] = 0
        images[1, 0, 0] = images[1, -1, -1] = 1  # corners
        filtered = target(sigma).filtered(images)
        np.testing.assert_allclose(filtered, by_scipy(images, gaussian(sigma)), atol=2e-6)
        assert filtered is not images

    def test_a_discount_is_a_factor_on_the_weights(self):
        images, rng = measured(noise=0.1), np.random.default_rng(0)
        weights, discount = (rng.uniform(0.1, 1.0, images.shape).astype(np.float32) for _ in range(2))
        valid = mask()
        both = replace(target(valid=valid), weights=weights, discount=discount)
        one = replace(target(valid=valid), weights=weights * discount)
        np.testing.assert_allclose(both.filtered(images), one.filtered(images), rtol=1e-5)
        np.testing.assert_array_equal(both.trust, valid * discount)
        np.testing.assert_array_equal(one.trust, valid)

    def test_masked_pixels_count_as_zero_before_the_filter(self):
        valid = mask()
        images = measured(noise=0.1)
        spoiled = np.where(valid, images, 1e6).astype(np.float32)
        filtered = target(1.5, valid=valid).filtered(spoiled)
        np.testing.assert_allclose(filtered, by_scipy(np.where(valid, images, 0), gaussian(1.5)), atol=2e-6)
