"""Series of states as steps: values come back within half a step, and smooth series take little room."""

import numpy as np
import pytest
from test_embedding import unpacked

from grainmotion.report.embedding import embed
from grainmotion.report.series_coding import MISSING_CODE, ZERO_CODE, embed_series, embed_sizes


def of_states(embedded) -> np.ndarray:
    """Values ``(states, n)`` of a series, as ``assets/decode.js`` decodes them."""
    codes = unpacked(embedded)
    if codes.dtype.kind == "f":
        return codes
    steps = (codes >> np.uint32(1)).view(np.int32) ^ -(codes & np.uint32(1)).astype(np.int32)
    numbers = np.cumsum(steps.view(np.uint32), axis=0, dtype=np.uint32).view(np.int32)
    known = np.where(numbers == MISSING_CODE, np.nan, numbers)
    if "step" in embedded:
        return known * embedded["step"]
    return np.where(numbers == ZERO_CODE, 0.0, np.exp(known * embedded["precision"]))


@pytest.fixture
def values() -> np.ndarray:
    """A series of 30 states that grows, with grains that have no value in some states."""
    random = np.random.default_rng(0)
    series = np.cumsum(random.normal(0.02, 0.002, (30, 500)), axis=0) + random.normal(size=500)
    series[4:9, 7] = series[0, 8] = series[-1, 9] = np.nan
    return series


def test_values_come_back_within_half_a_step(values):
    back = of_states(embed_series(values, 1e-4))
    np.testing.assert_array_equal(np.isnan(back), np.isnan(values))
    assert np.nanmax(np.abs(back - values)) <= 0.5001e-4


def test_sizes_come_back_within_half_the_precision(values):
    sizes = np.exp(5 * values)
    sizes[3] = 0.0
    back = of_states(embed_sizes(sizes, 2e-3))
    np.testing.assert_allclose(back, sizes, rtol=1.01e-3)


def test_what_is_not_finite_or_too_large_is_told_apart():
    nothing = of_states(embed_sizes(np.array([[np.inf, -1.0, np.nan, 0.0]]), 1e-3))
    np.testing.assert_array_equal(nothing, [[np.nan, np.nan, np.nan, 0.0]])
    large = np.array([[1e30, 0.25, np.inf], [1.0, np.nan, -3.0]])
    np.testing.assert_allclose(
        of_states(embed_series(large, 1e-5)), np.where(np.isinf(large), np.nan, large), rtol=1e-6
    )
    assert of_states(embed_series(np.zeros((3, 0)), 0.1)).shape == (3, 0)


def test_smooth_series_take_less_than_half_the_room_of_floats(values):
    assert 2 * len(embed_series(values, 1e-5)["data"]) < len(embed(values)["data"])
