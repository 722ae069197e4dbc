"""Independent calls of one function (`model.task_map`), shared out to the workers."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import TypeVar

from grainmotion.cluster.executor import Executor
from grainmotion.cluster.shared_store import SharedStore, StoredObject
from grainmotion.cluster.worker_threads import use_worker_threads

Item = TypeVar("Item")
Result = TypeVar("Result")


def call_each(
    executor: Executor, store: SharedStore, function: Callable[[Item], Result], items: Iterable[Item]
) -> list[Result]:
    """``function(item)`` of each item, a task each.

    Their large arrays are in files until all are done, but for those of which the store keeps files already.
    """
    own = store.within()
    try:
        called = own.put(function)
        return executor.results([executor.task(_call, function=called, item=own.put(item)) for item in items])
    finally:
        own.close()


def _call(function: StoredObject, item: StoredObject) -> object:
    with use_worker_threads():
        result: object = function.load()(item.load())
    return result
