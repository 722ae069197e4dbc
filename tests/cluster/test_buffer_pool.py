"""Memory that goes round, and never while anybody looks at it."""

import gc
import pickle

import numpy as np
import pytest

from grainmotion.cluster import buffer_pool


@pytest.fixture(autouse=True)
def none_kept(monkeypatch):
    monkeypatch.setattr(buffer_pool, "_FREE", [])


def place(array):
    return array.__array_interface__["data"][0]


def test_a_copy():
    array = np.arange(60.0, dtype=np.float32).reshape(3, 4, 5).transpose(2, 0, 1)
    found = buffer_pool.pooled_copy(array)
    np.testing.assert_array_equal(found, array)
    assert found.dtype == array.dtype
    assert found.flags.c_contiguous
    assert found.flags.writeable
    found[:] = 0
    assert array.any()


def test_memory_serves_again():
    found = buffer_pool.pooled_copy(np.ones(1000))
    before = place(found)
    del found
    gc.collect()
    again = buffer_pool.pooled_copy(np.zeros(900))
    assert place(again) == before
    assert not again.any()


@pytest.mark.parametrize("look", [lambda a: a[5:], lambda a: a.reshape(10, 100).T, lambda a: pickle.PickleBuffer(a)])
def test_not_while_somebody_looks(look):
    found = buffer_pool.pooled_copy(np.ones(1000))
    view, before = look(found), place(found)
    del found
    gc.collect()
    assert place(buffer_pool.pooled_copy(np.zeros(1000))) != before
    assert np.asarray(view).all()
    assert not buffer_pool._FREE or place(buffer_pool._FREE[0]) != before


def test_little_is_kept_and_no_other_size_served():
    many = [buffer_pool.pooled_copy(np.ones(1000)) for _ in range(buffer_pool.MAX_FREE_BUFFERS + 2)]
    many.clear()
    gc.collect()
    assert len(buffer_pool._FREE) == buffer_pool.MAX_FREE_BUFFERS
    kept = {place(k) for k in buffer_pool._FREE}
    others = [
        buffer_pool.pooled_copy(np.ones(500)),
        buffer_pool.pooled_copy(np.ones(1001)),
    ]  # held: else they come back, and push one out
    assert not kept & {place(other) for other in others}
    assert len(buffer_pool._FREE) == buffer_pool.MAX_FREE_BUFFERS
