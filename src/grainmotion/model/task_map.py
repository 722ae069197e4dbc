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
_HAVE_ALL: ContextVar[bool] = ContextVar("whether those who make calls have all items already", default=False)


def each(function: Callable[[Item], Result], items: Iterable[Item]) -> list[Result]:
    """``function(item)`` of each item, in their order.

    Workers get the function pickled: one of a module, a method of what can be pickled, or `functools.partial` of such.
    """
    mapper = _MAPPER.get()
    if mapper is None or (isinstance(items, Collection) and len(items) < 2):
        return [function(item) for item in counted(items)]
    return mapper(function, items)


def each_at_hand(function: Callable[[Item], Result], items: Iterable[Item]) -> list[Result]:
    """As `each`, of items that are large beside the work: shared only among those who have all of them already."""
    mapper = _MAPPER.get() if _HAVE_ALL.get() else None
    return [function(item) for item in counted(items)] if mapper is None else mapper(function, items)


def is_shared() -> bool:
    """Whether workers make the calls."""
    return _MAPPER.get() is not None


@contextmanager
def shared_among(mapper: Mapper | None, have_all: bool = False) -> Iterator[None]:
    """Let ``mapper`` make the calls of `each` until the end of a block; None is this process.

    ``have_all`` is whether all who make calls have the same items, as where they run the same code.
    """
    token, before = _MAPPER.set(mapper), _HAVE_ALL.set(have_all)
    try:
        yield
    finally:
        _MAPPER.reset(token)
        _HAVE_ALL.reset(before)


def not_shared() -> AbstractContextManager[None]:
    """Let this process make the calls until the end of a block."""
    return shared_among(None)
