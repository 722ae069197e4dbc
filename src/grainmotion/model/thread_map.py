"""Calls that do not depend on each other, made by all threads of this process."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from typing import TypeVar

import numba

from grainmotion.model.progress import counted

Item = TypeVar("Item")
Result = TypeVar("Result")


THREADS_OF_SLABS = 2
"""Threads that filter slabs of a volume at the same time: each has copies of its slab."""


def by_threads(function: Callable[[Item], Result], items: Iterable[Item], most: int | None = None) -> list[Result]:
    """As `made_by_threads`, all of them, with progress."""
    return list(made_by_threads(function, counted(items), most))


def made_by_threads(
    function: Callable[[Item], Result], items: Iterable[Item], most: int | None = None
) -> Iterator[Result]:
    """``function(item)`` of each item, in their order, by as many threads as kernels have, or by ``most``.

    It has to leave other threads room: numpy and kernels with ``nogil`` do; kernels with ``parallel``, which have
    these threads for themselves, must not be called in it.
    """
    threads = min(numba.get_num_threads(), most or numba.get_num_threads())
    if threads < 2:
        yield from map(function, items)
        return
    ahead = deque[Future[Result]]()
    pool = ThreadPoolExecutor(threads)
    try:
        for item in items:
            ahead.append(pool.submit(function, item))
            if len(ahead) > threads:
                yield ahead.popleft().result()
        while ahead:
            yield ahead.popleft().result()
    finally:
        pool.shutdown(cancel_futures=True)  # after an error, or Ctrl-C, nothing more is begun
