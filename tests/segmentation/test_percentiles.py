"""Medians and percentiles from histograms (`segmentation.percentiles`)."""

import numpy as np
import pytest

from grainmotion.kernels.value_histogram import count_equal_bins
from grainmotion.segmentation.blocks import Work
from grainmotion.segmentation.percentiles import FineBins, median, quantiles

VALUES = np.random.default_rng(0).normal(0.02, 1.0, 5001).astype(np.float32)


@pytest.mark.parametrize("values", [VALUES, VALUES[:-1], np.zeros(7, np.float32), np.full(4, 1.3, np.float32)])
def test_quantiles_are_exact(values):
    shares = [0.0, 0.002, 0.1, 0.5, 0.998, 1.0]
    expected = np.quantile(values.astype(float), shares)
    np.testing.assert_allclose(quantiles(Work(), values, shares), expected, rtol=1e-6, atol=1e-9)


def test_medians_of_groups():
    groups = np.random.default_rng(1).integers(0, 3, len(VALUES)).astype(np.uint8)
    assert median(Work(), VALUES, groups, 2) == pytest.approx(np.median(VALUES[groups == 2]))
    assert median(Work(), VALUES, groups) == pytest.approx(np.median(VALUES[groups > 0]))
    assert np.isnan(median(Work(), VALUES, groups, 7))


def test_fine_bins_are_as_wide_as_a_part_of_the_value():
    bins, values = FineBins.up_to(50.0), np.exp(VALUES)
    counts = bins.empty(2)
    bins.add(values, np.where(values > 1, 1, -1), counts)
    assert counts[0].sum() == 0
    assert bins.quantile(counts[1], 0.3) == pytest.approx(np.quantile(values[values > 1], 0.3), rel=1e-3)
    assert np.isnan(bins.quantile(counts[0], 0.5))


def test_bins_of_equal_width_are_those_of_numpy():
    counts, edges = np.histogram(VALUES, 256)
    found = np.zeros(256, np.int64)
    count_equal_bins(VALUES, edges, np.inf, found)
    np.testing.assert_array_equal(found, counts)
