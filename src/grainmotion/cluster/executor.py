"""Work: tasks handed to a Dask cluster, and what goes wrong with them."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

from grainmotion.errors import InputError

if TYPE_CHECKING:
    from dask.delayed import Delayed
    from distributed import Client, Future


@dataclass(frozen=True, eq=False)
class Executor:
    """The workers that a client reaches."""

    client: Client

    @property
    def hands(self) -> int:
        """How many workers there are now."""
        return max(1, len(self.client.scheduler_info(n_workers=-1)["workers"]))

    def task(self, function: Callable[..., Any], /, *tasks: Any, **literals: Any) -> Delayed:
        """``function(*tasks, **literals)``, to be done by a worker; literals go as they are."""
        from dask.delayed import delayed

        return delayed(partial(function, **literals), pure=False, traverse=False)(*tasks)

    def task_at(self, spot: str, function: Callable[..., Any], /, *tasks: Any, **literals: Any) -> Delayed:
        """The same, to be done by the worker of an address for as long as it lives."""
        import dask

        with dask.annotate(workers=[spot], allow_other_workers=True):
            return self.task(function, *tasks, **literals)

    def spots(self, count: int) -> list[str]:
        """Addresses of workers for so many tasks: neighbours on one worker, and all workers alike."""
        while not (workers := sorted(self.client.scheduler_info(n_workers=-1)["workers"])):
            self.client.wait_for_workers(1)  # a queue may be about to send some
        return [workers[k * len(workers) // count] for k in range(count)]

    def persist(self, tasks: Sequence[Delayed]) -> list[Delayed]:
        """Have tasks done, their results held by the workers for as long as somebody here refers to them."""
        return list(self.client.persist(list(tasks), optimize_graph=False))

    def results(self, tasks: Sequence[Delayed]) -> list[Any]:
        """Have tasks done; their results, which should be small.

        Raises
        ------
        InputError
            If one and the same task took several workers down, as it does where memory is too small for it.
        """
        held = [_held(task) for task in tasks]
        asked = self.client.compute([t for t, f in zip(tasks, held, strict=True) if f is None], optimize_graph=False)
        more = iter(asked)
        with _deaths_told():
            return list(self.client.gather([next(more) if future is None else future for future in held]))

    def as_done(self, more: Callable[[], tuple[str, Delayed] | None]) -> Iterator[tuple[str, Any]]:
        """Have tasks done, as many at once as there are workers; their names and results, whichever is there first.

        ``more()`` is asked for the next one after each; None is none for now.  Raises as `results` does.
        """
        from distributed import as_completed

        done, names = as_completed(loop=self.client.loop), dict[str, str]()
        while True:
            while len(names) < self.hands and (asked := more()) is not None:
                future = self.client.compute(asked[1], optimize_graph=False)
                names[future.key] = asked[0]
                done.add(future)
            if not names:
                return
            future = next(done)
            with _deaths_told():
                found = future.result()
            yield names.pop(future.key), found


@contextmanager
def _deaths_told() -> Iterator[None]:
    """Say what it means that a task took several workers down."""
    from distributed.scheduler import KilledWorker

    try:
        yield
    except KilledWorker as error:
        fact = f"workers died over {str(error.task).split('-')[0]}"
        raise InputError("cluster", fact, "give each worker more memory, or the run fewer voxels") from error


def _held(task: Delayed) -> Future | None:
    """What stands for the result of a task that is persisted: nothing more need be asked of the scheduler for it."""
    from distributed import Future

    graph = task.__dask_graph__()
    found = graph.get(task.key) if len(graph) == 1 else None
    return found if isinstance(found, Future) else None
