"""Ctrl-C and SIGTERM: the work ends with a line that says so, and the exit code that shells expect."""

from __future__ import annotations

import json
import os
import signal
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from importlib.metadata import version
from types import FrameType

from grainmotion.io.files import remove_unfinished

INTERRUPTED = "interrupted: finished stages are kept; the same command continues"
CONTINUE = "the same command continues"
GRACE_SECONDS = 1.5
"""Seconds in which Python has to look at a signal: a single call of a library may take longer than a person waits."""
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

    def is_late(self) -> None:
        """Ignore signals: the work is done, and what is being printed is to stay whole."""
        if threading.current_thread() is threading.main_thread():
            for number in (signal.SIGINT, signal.SIGTERM):
                signal.signal(number, signal.SIG_IGN)

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
        with _ended_if_stuck(stop):
            yield stop
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


@contextmanager
def _ended_if_stuck(stop: Stop) -> Iterator[None]:
    """End the process from another thread if the main one does not see a signal within `GRACE_SECONDS`.

    Results are complete files or none, so that nothing is lost but the step in hand.
    """
    reading, writing = os.pipe()
    os.set_blocking(writing, False)
    before = signal.set_wakeup_fd(writing, warn_on_full_buffer=False)

    def watch() -> None:
        while number := os.read(reading, 1):  # the system writes the number of a signal at once
            if stop.signal is None and number[0] in (signal.SIGINT, signal.SIGTERM):
                time.sleep(GRACE_SECONDS)
                if stop.signal is None and signal.getsignal(number[0]) is not signal.SIG_IGN:
                    stop.signal = number[0]
                    _print_interrupted(stop.code)
                    remove_unfinished()
                    os._exit(stop.code)
        os.close(reading)

    threading.Thread(target=watch, name="signals", daemon=True).start()
    try:
        yield
    finally:
        signal.set_wakeup_fd(before)
        os.close(writing)  # ends the thread


@contextmanager
def signals_end_the_command() -> Iterator[None]:
    """End the process with the interrupt's exit code, whatever a library made of it while it was imported.

    Once the command has ended by itself a signal can change nothing: the process ends at once, with the code that the
    command told.
    """
    try:
        with stoppable() as stop:
            try:
                yield
            except BaseException as error:
                if stop.signal is None and not isinstance(error, KeyboardInterrupt):
                    raise  # also the end of the command by its exit code
                _print_interrupted(stop.code)
                os._exit(stop.code)  # what is half imported may hang when Python tidies up
    except SystemExit as end:
        code = end.code if isinstance(end.code, int) else 0
        _signals_end_at_once(code)
        if code > SHELL_BASE:  # who stopped it waits, and Python tidies up for half a second
            with suppress(OSError, ValueError):
                sys.stdout.flush()
                sys.stderr.flush()
            os._exit(code)
        raise


def _print_interrupted(code: int) -> None:
    """The line, and the JSON document of a command that no command has been made of yet."""
    print(INTERRUPTED, file=sys.stderr, flush=True)
    if "--json" in sys.argv:
        print(json.dumps(interrupted_document(code), indent=2), flush=True)


def interrupted_document(code: int) -> dict[str, object]:
    """The document of a command that is interrupted while the program is still being loaded.

    It has the names of `grainmotion.cli.documents.Envelope`, which may be what could not be loaded.
    """
    error = {"kind": "interrupted", "where": "", "fact": "interrupted", "remedy": CONTINUE, "log": None}
    return {
        "schema": 1, "grainmotion": version("grainmotion"), "command": "grainmotion", "exit_code": code,
        "reason": "interrupted", "error": error, "findings": [], "result": None,
    }  # fmt: skip


def _signals_end_at_once(code: int) -> None:
    """From here on Ctrl-C and SIGTERM end the process with a code that is settled."""

    def end(_number: int, _frame: FrameType | None) -> None:
        with suppress(OSError, RuntimeError, ValueError):  # as of a pipe that is closed
            sys.stdout.flush()
        os._exit(code)

    if threading.current_thread() is threading.main_thread():
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, end)
