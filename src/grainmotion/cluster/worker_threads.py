"""Threads of a worker: its tasks run one after the other, and each uses all threads."""

from __future__ import annotations

import os
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache

import numba
from numba.core import config
from threadpoolctl import ThreadpoolController

_ONE_TASK = threading.Lock()  # numba's own threads are one pool, which two tasks must not enter at once


def limit_threads(count: int) -> None:
    """Start kernels with no more threads than these in this process, unless they have started: idle ones cost, too.

    Numba asks the environment whenever it compiles, and fails if that says another number than has started; nor can
    there be more than it found when it was imported.
    """
    os.environ["NUMBA_NUM_THREADS"] = str(min(count, _max_threads()))
    try:
        config.reload_config()
    except RuntimeError:
        os.environ["NUMBA_NUM_THREADS"] = str(_max_threads())


@contextmanager
def use_worker_threads() -> Iterator[None]:
    """Let kernels use the threads that this worker was given, one task at a time."""
    from distributed import get_worker

    try:
        count = get_worker().state.nthreads
    except ValueError:  # no worker: a test, or a debugger
        count = _max_threads()
    with _ONE_TASK:
        before = numba.get_num_threads()
        numba.set_num_threads(max(1, min(count, _max_threads())))
        try:
            with _libraries().limit(limits=1, user_api="blas"):  # as `track` does: sums depend on it
                yield
        finally:
            numba.set_num_threads(before)


def _max_threads() -> int:
    """Threads that kernels can have in this process."""
    most: int = vars(config)["NUMBA_NUM_THREADS"]
    return most


@cache
def _libraries() -> ThreadpoolController:
    """The libraries of this process that have threads of their own; to find them takes milliseconds."""
    return ThreadpoolController()
