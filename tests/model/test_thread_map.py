"""Calls by all threads: results in their order, errors as they come."""

import threading

import pytest

from grainmotion.model.thread_map import by_threads


@pytest.mark.parametrize("threads", [1, 3])
def test_results_are_in_their_order(monkeypatch, threads):
    monkeypatch.setattr("numba.get_num_threads", lambda: threads)
    assert by_threads(lambda k: k**2, range(20)) == [k**2 for k in range(20)]
    assert by_threads(lambda k: k, iter([])) == []


def test_threads_work_at_the_same_time(monkeypatch):
    monkeypatch.setattr("numba.get_num_threads", lambda: 2)
    meeting = threading.Barrier(2, timeout=30)
    by_threads(lambda _: meeting.wait(), range(2))  # each waits for the other one


@pytest.mark.parametrize("threads", [1, 3])
def test_nothing_is_begun_after_an_error(monkeypatch, threads):
    monkeypatch.setattr("numba.get_num_threads", lambda: threads)
    begun = []

    def fail(k):
        begun.append(k)
        raise ValueError(k)

    with pytest.raises(ValueError, match="0"):
        by_threads(fail, range(100))
    assert len(begun) < 10
