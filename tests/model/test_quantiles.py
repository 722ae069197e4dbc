"""Quantiles of values that come part by part."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from grainmotion.model.quantiles import median_of_labels, quantile_of_parts

VALUES = arrays.arrays(np.float32, st.integers(1, 40), elements=st.floats(-1e6, 1e6, width=32))


@given(VALUES, st.floats(0, 1))
def test_quantiles_are_those_of_all_values(values, share):
    found = quantile_of_parts(lambda: np.array_split(values, 3), share)
    assert found == pytest.approx(np.quantile(values.astype(float), share), rel=1e-9, abs=1e-9)


def test_order_of_the_parts_does_not_matter():
    values = np.random.default_rng(0).normal(0, 1, 101).astype(np.float32)
    assert quantile_of_parts(lambda: [values], 0.3) == quantile_of_parts(lambda: np.split(values[::-1], [7, 50]), 0.3)


def test_of_nothing():
    assert np.isnan(quantile_of_parts(lambda: [np.zeros(0, np.float32)], 0.5))


def test_median_of_labels():
    rng = np.random.default_rng(1)
    labels, values = rng.integers(0, 3, (4, 5, 6)), rng.normal(0, 1, (4, 5, 6)).astype(np.float32)
    assert median_of_labels(labels, values) == pytest.approx(np.median(values[labels > 0]))
    assert median_of_labels(labels, values, 0) == pytest.approx(np.median(values[labels == 0]))
    assert np.isnan(median_of_labels(labels, values, 7))
