"""The same trial for many seeds, on all cores: one process a core, one thread each."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TypeVar

from joblib import Parallel, cpu_count, delayed, parallel_config
from rich.progress import track

Arguments, Outcome = TypeVar("Arguments"), TypeVar("Outcome")


def run_trials(
    trial: Callable[[Arguments], Outcome], arguments: Sequence[Arguments], processes: int | None = None
) -> list[Outcome]:
    """``trial(argument)`` of each argument, in order, in as many processes as there are cores, at most ``processes``.

    Samples are too small to share among threads.
    """
    workers = min(cpu_count(), processes or cpu_count())
    with parallel_config(backend="loky", n_jobs=workers, inner_max_num_threads=1):
        outcomes = Parallel(return_as="generator", batch_size=1)(delayed(trial)(argument) for argument in arguments)
        return list(track(outcomes, trial.__module__, total=len(arguments)))
