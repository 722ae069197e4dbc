"""Sums of single numbers are rounded alike in any order."""

import numpy as np
import pytest

from grainmotion.backends.image_sums import in_precision

TIE = 1 + 2.0**-24
"""In the middle between two single numbers."""


@pytest.mark.parametrize("rest", [2.0**-52, -(2.0**-53), 2.0**-45])
def test_what_a_sum_may_lose_decides_nothing(rest):
    sums = np.array([[TIE, TIE + rest]])
    plain = sums.astype(np.float32)
    assert plain[0, 0] != plain[0, 1] or rest < 0
    rounded = in_precision(sums, np.dtype(np.float32))
    assert rounded.dtype == np.float32
    assert rounded[0, 0] == rounded[0, 1] == 1


def test_other_sums_are_rounded_as_usual():
    sums = np.random.default_rng(0).normal(size=(3, 40, 50)) * 10.0 ** np.arange(-3, 0)[:, None, None]
    np.testing.assert_array_equal(in_precision(sums, np.dtype(np.float32)), sums.astype(np.float32))
    single = sums.astype(np.float32).astype(float)
    np.testing.assert_array_equal(in_precision(single, np.dtype(np.float32)), single)
    np.testing.assert_array_equal(in_precision(np.zeros((2, 0)), np.dtype(np.float32)), np.zeros((2, 0)))


def test_double_sums_stay_as_they_are():
    sums = np.array([TIE, 0.1])
    np.testing.assert_array_equal(in_precision(sums, np.dtype(float)), sums)
