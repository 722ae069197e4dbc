"""Compilation of kernels when they are first used, told as it happens."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from numba.core.event import Event

COMPILING = "compiling for this processor, once: a first run takes about a minute longer, later ones load what was made"
EVENTS = ("numba:compile", "numba:run_pass")
"""A kernel is compiled, which is not asked for where the cache has it; and one of some dozen passes of that."""


@contextmanager
def compilation_told(tell: Callable[[], None]) -> Iterator[None]:
    """Call ``tell`` whenever the compiler begins something inside."""
    from numba.core import event as events  # takes a third of a second

    class Told(events.Listener):
        """Passes beginnings on."""

        def on_start(self, event: Event) -> None:
            tell()

        def on_end(self, event: Event) -> None:
            """Nothing: the next report follows."""

    told = Told()
    for kind in EVENTS:
        events.register(kind, told)
    try:
        yield
    finally:
        for kind in EVENTS:
            events.unregister(kind, told)
