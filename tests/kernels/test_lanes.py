"""Sixteen values at once are computed like arrays of numpy, in both precisions."""

import numba as nb
import numpy as np
import pytest

from grainmotion.kernels.lanes import LANES, absolute, larger, load, prefetch, ramp, smaller, splat, store


def expression(values, at, factor, out):
    prefetch(values, at - 1000)
    x = load(values, at)
    y = absolute(splat(factor) * ramp(factor) - x)
    store(out, at, larger(smaller(x + y, splat(factor)), x))


@pytest.mark.parametrize("precision", [np.float32, np.float64])
def test_compiled_lanes_are_arrays_of_numpy(precision):
    values = np.random.default_rng(0).normal(size=3 * LANES).astype(precision)
    plain, compiled = np.zeros_like(values), np.zeros_like(values)
    expression(values, 5, precision(0.3), plain)
    nb.njit(expression)(values, 5, precision(0.3), compiled)
    np.testing.assert_allclose(compiled, plain, rtol=1e-6)
    assert (compiled[5 : 5 + LANES] != 0).all()
    assert not compiled[:5].any()
    assert not compiled[5 + LANES :].any()
