"""Radiographs as bytes: what is lost, masked pixels, and averages over blocks."""

from __future__ import annotations

import numpy as np
import pytest

from grainmotion.report.image_coding import MASKED, Coding, block_means, row_differences

NOISE = 0.01


@pytest.fixture(scope="module")
def residual() -> np.ndarray:
    """Noise, a masked pixel, and misfits up to 100 times the noise."""
    image = np.random.default_rng(1).normal(0, NOISE, (60, 50))
    image[3, 4] = np.nan
    image[10, 10:20] = np.linspace(0.05, 1.0, 10)
    return image


@pytest.fixture(scope="module")
def simulated() -> np.ndarray:
    return np.hypot(*np.mgrid[:60, :50]) / 30


class TestCoding:
    def test_simulated_values_are_kept_to_half_a_step(self, simulated, residual):
        coding = Coding.of(simulated, residual)
        found = coding.simulated_values(coding.simulated_bytes(simulated))
        np.testing.assert_allclose(found, simulated, atol=0.501 * np.ptp(simulated) / 254)

    def test_small_residuals_are_kept_to_a_fraction_of_the_noise(self, simulated, residual):
        coding = Coding.of(simulated, residual)
        found = coding.residual_values(coding.residual_bytes(residual))
        small = np.abs(residual) < 2 * NOISE
        np.testing.assert_allclose(found[small], residual[small], atol=0.25 * NOISE)

    def test_large_residuals_are_kept_to_a_few_per_cent(self, simulated, residual):
        coding = Coding.of(simulated, residual)
        assert coding.knee is not None
        found = coding.residual_values(coding.residual_bytes(residual))
        np.testing.assert_allclose(found[10, 10:20], residual[10, 10:20], rtol=0.05)

    def test_residuals_of_noise_alone_have_even_steps(self, simulated):
        noise = np.random.default_rng(2).normal(0, NOISE, (60, 50))
        assert Coding.of(simulated, noise).knee is None

    def test_zero_is_kept_and_masked_pixels_stay_masked(self, simulated, residual):
        coding = Coding.of(simulated, residual)
        coded = coding.residual_bytes(np.array([[0.0, np.nan]]))
        assert coded[0, 1] == MASKED
        np.testing.assert_array_equal(coding.residual_values(coded), [[0.0, np.nan]])
        assert (coding.residual_bytes(residual) == MASKED).sum() == 1

    @pytest.mark.parametrize("value", [0.0, 2.5, np.nan])
    def test_constant_images(self, value):
        image = np.full((4, 5), value)
        coding = Coding.of(image, 0 * image)
        np.testing.assert_allclose(coding.simulated_values(coding.simulated_bytes(image)), image)
        np.testing.assert_allclose(coding.residual_values(coding.residual_bytes(0 * image)), 0 * image)

    def test_one_wrong_pixel_among_exact_ones(self, simulated):
        residual = np.zeros_like(simulated)
        residual[5, 5] = -0.3
        coding = Coding.of(simulated, residual)
        np.testing.assert_allclose(coding.residual_values(coding.residual_bytes(residual)), residual, rtol=0.2)


class TestBlockMeans:
    def test_one_pixel_a_block_is_the_image(self):
        image = np.arange(12.0).reshape(3, 4)
        assert block_means(image, 1) is image

    def test_blocks_are_averaged_those_at_the_edges_over_what_they_have(self):
        image = np.arange(15.0).reshape(3, 5)
        expected = [[image[:2, :2].mean(), image[:2, 2:4].mean(), image[:2, 4:].mean()]]
        expected += [[image[2:, :2].mean(), image[2:, 2:4].mean(), image[2:, 4:].mean()]]
        np.testing.assert_allclose(block_means(image, 2), expected)

    def test_masked_pixels_do_not_count_and_mostly_masked_blocks_are_masked(self):
        image = np.array([[1.0, np.nan, 5.0, np.nan], [3.0, 2.0, np.nan, np.nan]])
        np.testing.assert_allclose(block_means(image, 2), [[2.0, np.nan]])


def test_rows_are_the_sums_of_their_differences():
    coded = np.random.default_rng(0).integers(0, 256, (5, 4)).astype(np.uint8)
    np.testing.assert_array_equal(np.cumsum(row_differences(coded), axis=0, dtype=np.uint8), coded)
