"""Progress of a long work: steps with names, and the share of a step that is done.

Functions that have steps take ``progress(message, done, total)`` and call it when a step begins.  Loops inside a step,
however deep, go through `counted`: each of their turns reports the step's message again, with the share of the step
that is done by then.  Who listens is a variable of the context (`listening`), so that a loop over views, grains, blocks
or files needs no argument for it; where nobody listens it costs nothing (decision 0051).
"""

from __future__ import annotations

import time
from collections.abc import Collection, Iterable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from typing import TYPE_CHECKING, TypeVar

if TYPE_CHECKING:
    from grainmotion._typing import Progress

T = TypeVar("T")
SHARES = 1000
"""Parts in which the share of a step is told."""
MIN_INTERVAL = 0.1
"""Seconds between two reports of `counted`: loops may be quick."""


class Listener:
    """Hands reports on, and knows which step they are in.

    A step reaches to the next value of ``done``; how far that is follows from the last two reports of the same total.
    """

    def __init__(self, progress: Progress) -> None:
        self.progress = progress
        self.step: tuple[str, int, int] = ("", 0, 1)
        self.width, self.share, self.told = 1, 0.0, -MIN_INTERVAL

    def __call__(self, message: str, done: int, total: int) -> None:
        """A step begins."""
        _, before, of = self.step
        self.width = done - before if of == total and done > before else 1
        self.step, self.share, self.told = (message, done, total), 0.0, time.monotonic()
        self.progress(message, done, total)

    def inside(self, share: float) -> None:
        """So much of the step is done, 0 to 1; never less than before, as where one loop follows another."""
        now = time.monotonic()
        self.share = max(self.share, share)
        if now - self.told >= MIN_INTERVAL:
            self.told = now
            message, done, total = self.step
            self.progress(
                message, min(round(SHARES * (done + self.width * self.share)), SHARES * total), SHARES * total
            )


class Part:
    """A part of a step, from one share of it to another."""

    def __init__(self, listener: Listener, first: float = 0.0, end: float = 1.0) -> None:
        self.listener, self.first, self.end, self.step = listener, first, end, listener.step

    def within(self, first: float, end: float) -> Part:
        """A part of this part, or of the step that has begun since."""
        if self.step is not self.listener.step:
            return Part(self.listener, first, end)
        width = self.end - self.first
        return Part(self.listener, self.first + width * first, self.first + width * end)


_PART: ContextVar[Part | None] = ContextVar("part", default=None)


@contextmanager
def listening(progress: Progress | None) -> Iterator[Progress | None]:
    """Let `counted` report to ``progress``; gives what steps are to be reported to, None for None."""
    outer = _PART.get()
    if progress is None or (outer is not None and outer.listener is progress):
        yield progress
        return
    listener = Listener(progress)
    _PART.set(Part(listener))
    try:
        yield listener
    finally:
        _PART.set(outer)


def counted(items: Iterable[T], total: int | None = None) -> Iterator[T]:
    """The items, one by one, with a report before each; ``total`` is needed where they have no length."""
    part = _PART.get()
    if part is None:
        yield from items
        return
    listener, step = part.listener, part.listener.step
    count = total if total is not None else len(items) if isinstance(items, Collection) else 0
    for k, item in enumerate(items):
        if listener.step is not step:  # the loop's own turns begin steps
            inner = Part(listener)
        else:
            inner = part.within(min(k / count, 1.0), min((k + 1) / count, 1.0)) if count else part
        listener.inside(inner.first)
        _PART.set(inner)
        try:
            yield item
        finally:
            if _PART.get() is inner:  # else the listener has gone, as after an error
                _PART.set(part)


def begin(message: str, done: int = 0, total: int = 1) -> None:
    """Report a step where no ``progress`` is at hand, if anybody listens."""
    part = _PART.get()
    if part is not None:
        part.listener(message, done, total)


def prefixed(progress: Progress | None, stage: str) -> Progress | None:
    """Progress of a part of the work, with the name of its stage before each message."""
    if progress is None:
        return None
    return lambda message, done, total: progress(f"{stage}: {message}", done, total)
