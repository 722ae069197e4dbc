"""Vectors of eight and of sixteen numbers: compiled code computes what NumPy does with arrays of as many."""

import numba as nb
import numpy as np
import pytest

from grainmotion.kernels import vector_functions as f
from grainmotion.kernels.vector_memory import gathered, loaded, pairs, prefetch, stored, stored_first


def arithmetic(array, out, width):
    a, b = loaded(array, 3, width), loaded(array, 20, width)
    stored(out, 0, a + b * 2 - 1.5 / a)
    stored(out, width, -a / b)
    stored(out, 2 * width, f.minimum(a, b))
    stored(out, 3 * width, f.maximum(a, 0.25))
    stored(out, 4 * width, f.square_root(f.absolute(a)))


def choices(array, out, width):
    a, b = loaded(array, 3, width), loaded(array, 20, width)
    stored(out, 0, f.where(a < b, a, b))
    stored(out, width, f.where((a <= b) & (a >= 0.0), 1.0, a))
    stored(out, 2 * width, f.where(a != b, b, 7.0))
    at = 3 * width
    out[at], out[at + 1] = f.least(a), f.largest(b)
    out[at + 2], out[at + 3] = f.any_lane(a < 1e9), f.any_lane(a > 1e9)


def precisions(array, out, width):
    a = f.as_double(loaded(array, 3, width)) * f.counted(2, width) + f.spread(0.1, width)
    stored(out, 0, f.as_precision(a, array) * loaded(array, 3, width))
    whole = f.truncated(a)
    stored(out, width, f.as_precision(whole * np.int32(3) + whole, array))
    stored(out, 2 * width, f.as_precision(f.inside(whole, np.int32(4)), array))
    stored(out, 3 * width, f.counted(array[0], width) * f.spread(array[1], width))


def reading(array, out, width):
    prefetch(array, -1000)
    index = f.inside(f.truncated(f.counted(0, width) * f.counted(-3, width)), np.int32(25))
    one, two = pairs(array, 5, index)
    stored(out, 0, gathered(array, 2, index))
    stored_first(out, width, one, 3)
    stored_first(out, 2 * width, two, 1)
    stored_first(out, 3 * width, two, width)


@pytest.mark.parametrize("width", [8, 16])
@pytest.mark.parametrize("precision", [np.float32, np.float64])
@pytest.mark.parametrize("function", [arithmetic, choices, precisions, reading])
def test_compiled_vectors_equal_arrays(function, precision, width):
    @nb.njit
    def compiled_function(array, out):
        compiled_body(array, out, width)

    compiled_body = nb.njit(function)
    array = np.random.default_rng(0).uniform(-3, 3, 64).astype(precision)
    array[3], array[20] = 0.5, 0.5
    computed, expected = np.full(7 * width, 9, precision), np.full(7 * width, 9, precision)
    compiled_function(array, computed)
    function(array, expected, width)
    np.testing.assert_allclose(computed, expected, rtol=2 * np.finfo(precision).eps)  # products and sums may be fused
    assert (computed[-width:] == 9).all()


def test_storing_some_lanes_leaves_the_rest_of_the_array():
    out = np.zeros(12)
    nb.njit(lambda array, count: stored_first(array, 2, f.counted(1, 8), count))(out, 5)
    assert out.tolist() == [0, 0, 1, 2, 3, 4, 5, 0, 0, 0, 0, 0]


@pytest.mark.parametrize("index", [-1, -(2**31), 5, 9, 2**31 - 1])
def test_an_index_that_leaves_the_array_becomes_the_last(index):
    @nb.njit
    def kept(array, last):
        return f.largest(f.as_precision(f.inside(f.truncated(f.spread(array[0], 8)), last), array))

    assert kept(np.array([float(index)]), np.int32(5)) == 5


def test_vectors_of_different_widths_do_not_mix():
    @nb.njit
    def mixed(array):
        return f.least(loaded(array, 0, 8) + loaded(array, 0, 16))

    with pytest.raises(nb.TypingError):
        mixed(np.zeros(16))


def test_rows_of_other_arrays_are_not_read():
    @nb.njit
    def every_second(array):
        return f.least(loaded(array[::2], 0, 8))

    with pytest.raises(nb.TypingError):
        every_second(np.zeros(16))
