"""Progress of a long work: steps with names, and the share of a step that is done.

Functions that have steps take ``progress(message, done, total)`` and call it when a step begins.  Loops inside a step,
however deep, go through `counted`: each of their turns reports the step's message again, with the share of the step
that is done by then.  Who listens is a variable of the context (`listening`), so that a loop over views, grains, blocks
or files needs no argument for it; where nobody listens it costs nothing (decision 0051).
"""

from __future__ import annotations

import re
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
_DETAIL = re.compile(r" \([^()]*\)$")


class Listener:
    """Hands reports on, and knows which step they are in.

    A step reaches to the next value of ``done``; how far that is follows from the last two reports of the same total.
    If it was less, the share stays until the next steps have caught up: it never falls while ``done`` does not.
    """

    def __init__(self, progress: Progress) -> None:
        self.progress = progress
        self.step: tuple[str, int, int] = ("", 0, 1)
        self.width, self.furthest, self.told = 1, 0, -MIN_INTERVAL
        self.share, self.what, self.within = 0.0, "", (0.0, 1.0)

    def __call__(self, message: str, done: int, total: int) -> None:
        """A step begins."""
        last, before, of = self.step
        self.width = done - before if of == total and done > before else 1
        if of != total or done < before or (total == 1 and message != last):  # something else begins
            self.furthest = 0
        self.step, self.told = (message, done, total), time.monotonic()
        self.share, self.what, self.within = 0.0, "", (0.0, 1.0)
        if self.furthest > SHARES * done:
            self.progress(message, self.furthest, SHARES * total)
        else:
            self.progress(message, done, total)

    def detail(self, what: str, first: float, end: float) -> None:
        """A part of the step begins, from one share of it to another."""
        self.what, self.within = what, (first, end)
        self.told = -MIN_INTERVAL
        self.inside(0.0)

    def inside(self, share: float) -> None:
        """So much of the part in hand is done, 0 to 1; never less than before, as where one loop follows another."""
        now = time.monotonic()
        first, end = self.within
        self.share = max(self.share, first + (end - first) * share)
        if now - self.told >= MIN_INTERVAL:
            self.told = now
            message, done, total = self.step
            reached = min(round(SHARES * (done + self.width * self.share)), SHARES * total)
            self.furthest = max(self.furthest, reached)
            told = f"{message} ({self.what})" if self.what else message
            self.progress(told, self.furthest, SHARES * total)


class Part:
    """A part of a step, from one share of it to another; loops inside loops share it."""

    def __init__(self, listener: Listener, first: float = 0.0, end: float = 1.0) -> None:
        self.listener, self.first, self.end = listener, first, end
        self.place = listener.step, listener.what

    @property
    def is_past(self) -> bool:
        """Whether another step, or part of it, has begun since."""
        return self.place != (self.listener.step, self.listener.what)

    def share(self, first: float, end: float) -> Part:
        """A part of this part, or of what has begun since."""
        if self.is_past:
            return Part(self.listener, first, end)
        width = self.end - self.first
        return Part(self.listener, self.first + width * first, self.first + width * end)


_PART: ContextVar[Part | None] = ContextVar("part of a step", default=None)


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
    listener, started = part.listener, Part(part.listener)
    count = total if total is not None else len(items) if isinstance(items, Collection) else 0
    for k, item in enumerate(items):
        inner = part
        if started.is_past:  # the loop's own turns begin steps
            inner = Part(listener)
        elif count:
            inner = part.share(min(k / count, 1.0), min((k + 1) / count, 1.0))
        listener.inside(inner.first)
        _PART.set(inner)
        try:
            yield item
        finally:
            if _PART.get() is inner:  # else the listener has gone, as after an error
                _PART.set(part)


def reached(share: float) -> None:
    """Report that so much of the part in hand is done, 0 to 1, where nobody knows how many turns it takes."""
    part = _PART.get()
    if part is not None:
        part.listener.inside(part.share(share, share).first)


def begin(message: str, done: int = 0, total: int = 1) -> None:
    """Report a step where no ``progress`` is at hand, if anybody listens."""
    part = _PART.get()
    if part is not None:
        part.listener(message, done, total)


def detail(what: str, done: int = 0, total: int = 1, parts: int = 1) -> None:
    """Report ``parts`` parts of the step in hand after ``done`` of ``total``, with ``what`` in brackets behind it."""
    part = _PART.get()
    if part is not None:
        part.listener.detail(what, done / total, (done + parts) / total)


def without_detail(message: str) -> str:
    """The message of a step without what is in brackets at its end."""
    return _DETAIL.sub("", message)


def prefixed(progress: Progress | None, stage: str) -> Progress | None:
    """Progress of a part of the work, with the name of its stage before each message."""
    if progress is None:
        return None
    return lambda message, done, total: progress(f"{stage}: {message}", done, total)
