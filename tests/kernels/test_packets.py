"""Eight numbers at once: compiled code computes what NumPy does with arrays of eight."""

import numba as nb
import numpy as np
import pytest

from grainmotion.kernels import packets
from grainmotion.kernels.packet_memory import gathered, loaded, pairs, stored

PACKET_SIZE = packets.PACKET_SIZE


def arithmetic(array, out):
    a, b = loaded(array, 3), loaded(array, 20)
    stored(out, 0, PACKET_SIZE, a + b * 2 - 1.5 / a)
    stored(out, 8, PACKET_SIZE, -a / b)
    stored(out, 16, PACKET_SIZE, packets.minimum(a, b))
    stored(out, 24, PACKET_SIZE, packets.maximum(a, 0.25))
    stored(out, 32, PACKET_SIZE, packets.square_root(packets.absolute(a)))


def choices(array, out):
    a, b = loaded(array, 3), loaded(array, 20)
    stored(out, 0, PACKET_SIZE, packets.where(a < b, a, b))
    stored(out, 8, PACKET_SIZE, packets.where((a <= b) & (a >= 0.0), 1.0, a))
    stored(out, 16, PACKET_SIZE, packets.where(a != b, b, 7.0))
    out[24], out[25] = packets.least(a), packets.largest(b)
    out[26], out[27] = packets.any_lane(a < 1e9), packets.any_lane(a > 1e9)


def precisions(array, out):
    a = packets.as_double(loaded(array, 3)) * packets.counted(2) + packets.spread(0.1)
    stored(out, 0, PACKET_SIZE, packets.as_precision(a, array) * loaded(array, 3))
    whole = packets.truncated(a)
    stored(out, 8, PACKET_SIZE, packets.as_precision(whole * np.int32(3) + whole, array))
    stored(out, 16, PACKET_SIZE, packets.as_precision(packets.inside(whole, np.int32(4)), array))


def reading(array, out):
    index = packets.inside(packets.truncated(packets.counted(0) * packets.counted(-3)), np.int32(25))
    one, two = pairs(array, 5, index)
    stored(out, 0, PACKET_SIZE, gathered(array, 2, index))
    stored(out, 8, 3, one)
    stored(out, 16, 1, two)
    stored(out, 24, PACKET_SIZE, two)


@pytest.mark.parametrize("precision", [np.float32, np.float64])
@pytest.mark.parametrize("function", [arithmetic, choices, precisions, reading])
def test_compiled_lanes_equal_arrays_of_eight(function, precision):
    array = np.random.default_rng(0).uniform(-3, 3, 64).astype(precision)
    array[3], array[20] = 0.5, 0.5
    computed, expected = np.full(56, 9, precision), np.full(56, 9, precision)
    nb.njit(function)(array, computed)
    function(array, expected)
    np.testing.assert_allclose(computed, expected, rtol=2 * np.finfo(precision).eps)  # products and sums may be fused
    assert (computed[-8:] == 9).all()


def test_storing_some_lanes_leaves_the_rest_of_the_array():
    out = np.zeros(12)
    nb.njit(lambda array, count: stored(array, 2, count, packets.counted(1)))(out, 5)
    assert out.tolist() == [0, 0, 1, 2, 3, 4, 5, 0, 0, 0, 0, 0]


@pytest.mark.parametrize("index", [-1, -(2**31), 5, 9, 2**31 - 1])
def test_an_index_that_leaves_the_array_becomes_the_last(index):
    @nb.njit
    def kept(array, last):
        return packets.largest(
            packets.as_precision(packets.inside(packets.truncated(packets.spread(array[0])), last), array)
        )

    assert kept(np.array([float(index)]), np.int32(5)) == 5
