"""The same trial for many seeds, on all cores: one process a core, one thread each."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from typing import TypeVar

from rich.progress import track

Arguments, Outcome = TypeVar("Arguments"), TypeVar("Outcome")
THREADS = ("NUMBA_NUM_THREADS", "OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS")


def each(
    trial: Callable[[Arguments], Outcome], arguments: Sequence[Arguments], processes: int | None = None
) -> list[Outcome]:
    """``trial(argument)`` of each argument, in order, in as many processes as there are cores, at most ``processes``.

    Samples are too small to share among threads.
    """
    cores = len(os.sched_getaffinity(0))
    kept = {name: os.environ.get(name) for name in THREADS}
    os.environ.update(dict.fromkeys(THREADS, "1"))
    try:
        with ProcessPoolExecutor(min(cores, processes or cores), get_context("spawn")) as pool:
            return list(track(pool.map(trial, arguments), trial.__module__, total=len(arguments)))
    finally:
        for name, value in kept.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value
