"""Many calls of one function that do not depend on each other, and who makes them.

A loop of independent trials, as of geometries or of grains, goes through `each`.  Where workers share a run, they make
the calls (`shared_among`, which `grainmotion.cluster` sets); else this process makes them one after the other.  Who
does is a variable of the context, so that no function between run and loop has to hand it on.  Results are the same
for any number of workers, as a call is made as a whole by one process.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator
from contextlib import AbstractContextManager, contextmanager
from contextvars import ContextVar
from typing import Protocol, TypeVar

from grainmotion.model.progress import counted

Item = TypeVar("Item")
Result = TypeVar("Result")


class Mapper(Protocol):
    """Calls a function with each of some items; the results in their order."""

    def __call__(self, function: Callable[[Item], Result], items: Iterable[Item], /) -> list[Result]: ...


_MAPPER: ContextVar[Mapper | None] = ContextVar("who makes independent calls", default=None)


def each(function: Callable[[Item], Result], items: Iterable[Item]) -> list[Result]:
    """``function(item)`` of each item, in their order.

    Workers get the function pickled: one of a module, a method of what can be pickled, or `functools.partial` of such.
    """
    mapper = _MAPPER.get()
    if mapper is None or (isinstance(items, Collection) and len(items) < 2):
        return [function(item) for item in counted(items)]
    return mapper(function, items)


def is_shared() -> bool:
    """Whether workers make the calls."""
    return _MAPPER.get() is not None


@contextmanager
def shared_among(mapper: Mapper | None) -> Iterator[None]:
    """Let ``mapper`` make the calls of `each` until the end of a block; None is this process."""
    token = _MAPPER.set(mapper)
    try:
        yield
    finally:
        _MAPPER.reset(token)


def not_shared() -> AbstractContextManager[None]:
    """Let this process make the calls until the end of a block."""
    return shared_among(None)
