"""Large arrays are made where a run wants them, small ones in memory."""

from __future__ import annotations

import numpy as np

from grainmotion.model.large_arrays import MAX_SMALL_ARRAY, large_arrays_in, large_copy, large_empty, large_zeros

LARGE = (MAX_SMALL_ARRAY // 8 + 1,)


def test_without_a_storage_they_are_in_memory():
    assert large_empty(LARGE, float).base is None
    assert not large_zeros(LARGE, float).any()


def test_a_storage_makes_the_large_ones_only():
    made = []

    def storage(shape, dtype):
        made.append((shape, np.dtype(dtype)))
        return np.zeros(shape, dtype)

    with large_arrays_in(storage):
        large_empty((10, 10), np.float32)
        array = large_zeros(LARGE, float)
        array[-1] = 3
        copy = large_copy(array)
        with large_arrays_in(None):
            large_empty(LARGE, bool)
    large_empty(LARGE, bool)
    assert made == [(LARGE, np.dtype(float))] * 2
    assert copy[-1] == 3
