"""Executor: runs tasks on a Dask cluster, and explains their failures."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

from grainmotion.errors import InputError
from grainmotion.model.progress import counted

if TYPE_CHECKING:
    from dask.delayed import Delayed
    from distributed import Client, Future


TASKS_AHEAD = 4
"""Tasks a worker whose results may wait for those before them."""


@dataclass(frozen=True, eq=False)
class Executor:
    """Runs tasks on the workers of a client."""

    client: Client

    @property
    def worker_count(self) -> int:
        """Number of workers at present."""
        return max(1, len(self.workers()))

    def workers(self) -> list[str]:
        """Addresses of the workers that are there.

        `Client.scheduler_info` hands out what it keeps, which Dask replaces every two seconds by a record without any
        worker: a state was begun anew because all workers seemed to be lost.
        """
        return sorted(self.client.nthreads())

    def task(self, function: Callable[..., object], /, *tasks: object, **literals: object) -> Delayed:
        """``function(*tasks, **literals)``, to be run by a worker; literals are sent as they are."""
        from dask.delayed import delayed

        return delayed(partial(function, **literals), pure=False, traverse=False)(*tasks)

    def task_at(self, address: str, function: Callable[..., object], /, *tasks: object, **literals: object) -> Delayed:
        """The same at the worker of an address; at another if that worker is lost."""
        import dask

        with dask.annotate(workers=[address], allow_other_workers=True):
            return self.task(function, *tasks, **literals)

    def addresses(self, count: int) -> list[str]:
        """Addresses of workers for so many tasks, shared evenly, with neighbours on one worker."""
        while not (workers := self.workers()):
            self.client.wait_for_workers(1)  # a queue may be about to send some
        return [workers[k * len(workers) // count] for k in range(count)]

    def persist(self, tasks: Sequence[Delayed]) -> list[Delayed]:
        """Run tasks; workers hold the results for as long as this process refers to them."""
        return list(self.client.persist(list(tasks), optimize_graph=False))

    def results(self, tasks: Sequence[Delayed]) -> list[Any]:
        """Run tasks and fetch their results, which should be small.

        Raises
        ------
        InputError
            If the same task ended several workers, as it does where their memory is too small for it.
        """
        from distributed import as_completed

        held = [_future_of(task) for task in tasks]
        asked = self.client.compute([t for t, f in zip(tasks, held, strict=True) if f is None], optimize_graph=False)
        more = iter(asked)
        futures = [next(more) if future is None else future for future in held]
        for _ in counted(as_completed(futures), len(futures)):
            pass  # progress, until all are there
        with _report_dead_workers():
            return list(self.client.gather(futures))

    def in_order(self, tasks: Iterable[Delayed]) -> Iterator[object]:
        """Results of tasks, one after the other; only a few are computed ahead, so that they need little memory here.

        Raises as `results` does.
        """
        ahead = TASKS_AHEAD * self.worker_count
        futures: deque[Future] = deque()
        for task in tasks:
            futures.append(self.client.compute(task, optimize_graph=False))
            if len(futures) > ahead:
                yield _result_of(futures.popleft())
        while futures:
            yield _result_of(futures.popleft())

    def as_completed(self, more: Callable[[], tuple[str, Delayed] | None]) -> Iterator[tuple[str, Any]]:
        """Run tasks, as many at once as there are workers; names and results, in the order in which they are ready.

        ``more()`` gives the next task after each; None is none for now.  Raises as `results` does.
        """
        from distributed import as_completed

        done, names = as_completed(loop=self.client.loop), dict[str, str]()
        while True:
            while len(names) < self.worker_count and (asked := more()) is not None:
                future = self.client.compute(asked[1], optimize_graph=False)
                names[future.key] = asked[0]
                done.add(future)
            if not names:
                return
            future = next(done)
            yield names.pop(future.key), _result_of(future)


def _result_of(future: Future) -> object:
    with _report_dead_workers():
        result: object = future.result()
    return result


@contextmanager
def _report_dead_workers() -> Iterator[None]:
    """Explain that a task ended several workers."""
    from distributed.scheduler import KilledWorker

    try:
        yield
    except KilledWorker as error:
        fact = f"workers died over {str(error.task).split('-')[0]}"
        raise InputError("cluster", fact, "give each worker more memory, or the run fewer voxels") from error


def _future_of(task: Delayed) -> Future | None:
    """The future of a task that is persisted: the scheduler need not be asked for it again."""
    from distributed import Future

    graph = task.__dask_graph__()
    entry = graph.get(task.key) if len(graph) == 1 else None
    return entry if isinstance(entry, Future) else None
