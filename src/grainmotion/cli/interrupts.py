"""Ctrl-C and SIGTERM: the work ends with a line that says so, and the exit code that shells expect."""

from __future__ import annotations

import os
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager

INTERRUPTED = "interrupted: finished stages are kept; the same command continues"
SHELL_BASE = 128
"""Shells tell a command that a signal ended by this number plus that of the signal."""


class Stop:
    """The signal that came, if any: an exception that is raised inside a callback of a library can be lost."""

    def __init__(self) -> None:
        self.signal: int | None = None

    @property
    def code(self) -> int:
        """130 after Ctrl-C (also where another handler than ours raised it), 143 after SIGTERM."""
        return SHELL_BASE + (self.signal or signal.SIGINT)

    def check(self) -> None:
        """Raise the interrupt again if it was lost."""
        if self.signal is not None:
            raise KeyboardInterrupt


@contextmanager
def stoppable() -> Iterator[Stop]:
    """Raise `KeyboardInterrupt` at Ctrl-C and SIGTERM inside, and keep which of them it was.

    Threads other than the main one cannot set handlers: there the signals do what they did before.
    """
    stop = Stop()

    def raised(number: int, _frame: object) -> None:
        stop.signal = number
        raise KeyboardInterrupt

    if threading.current_thread() is not threading.main_thread():
        yield stop
        return
    before = {number: signal.signal(number, raised) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield stop
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


@contextmanager
def signals_end_the_command() -> Iterator[None]:
    """End the process with the interrupt's exit code, whatever a library made of it while it was imported."""
    with stoppable() as stop:
        try:
            yield
        except BaseException as error:
            if stop.signal is None and not isinstance(error, KeyboardInterrupt):
                raise  # also the end of the command by its exit code
            print(INTERRUPTED, file=sys.stderr, flush=True)
            os._exit(stop.code)  # what is half imported may hang when Python tidies up
