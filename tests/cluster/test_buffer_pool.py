"""`cluster.buffer_pool`: memory is used again, but not while an array or a view still refers to it."""

import gc
import pickle

import numpy as np
import pytest

from grainmotion.cluster import buffer_pool


@pytest.fixture(autouse=True)
def empty_pool(monkeypatch):
    """Start every test without free buffers."""
    monkeypatch.setattr(buffer_pool, "_FREE", [])


def address(array):
    """Address of the array's first element."""
    return array.__array_interface__["data"][0]


def test_copy_is_contiguous_writable_and_independent():
    array = np.arange(60.0, dtype=np.float32).reshape(3, 4, 5).transpose(2, 0, 1)
    copy = buffer_pool.pooled_copy(array)
    np.testing.assert_array_equal(copy, array)
    assert copy.dtype == array.dtype
    assert copy.flags.c_contiguous
    assert copy.flags.writeable
    copy[:] = 0
    assert array.any()


def test_freed_memory_is_used_again():
    first = buffer_pool.pooled_copy(np.ones(1000))
    first_address = address(first)
    del first
    gc.collect()
    again = buffer_pool.pooled_copy(np.zeros(900))
    assert address(again) == first_address
    assert not again.any()


@pytest.mark.parametrize("view_of", [lambda a: a[5:], lambda a: a.reshape(10, 100).T, lambda a: pickle.PickleBuffer(a)])
def test_memory_is_not_used_again_while_a_view_exists(view_of):
    copy = buffer_pool.pooled_copy(np.ones(1000))
    view, copy_address = view_of(copy), address(copy)
    del copy
    gc.collect()
    assert address(buffer_pool.pooled_copy(np.zeros(1000))) != copy_address
    assert np.asarray(view).all()
    assert not buffer_pool._FREE or address(buffer_pool._FREE[0]) != copy_address


def test_few_buffers_are_kept_and_serve_similar_sizes_only():
    many = [buffer_pool.pooled_copy(np.ones(1000)) for _ in range(buffer_pool.MAX_FREE_BUFFERS + 2)]
    many.clear()
    gc.collect()
    assert len(buffer_pool._FREE) == buffer_pool.MAX_FREE_BUFFERS
    kept = {address(k) for k in buffer_pool._FREE}
    others = [
        buffer_pool.pooled_copy(np.ones(500)),
        buffer_pool.pooled_copy(np.ones(1001)),
    ]  # kept alive: freed, they would return to the pool and displace a buffer
    assert not kept & {address(other) for other in others}
    assert len(buffer_pool._FREE) == buffer_pool.MAX_FREE_BUFFERS
