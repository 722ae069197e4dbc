"""Standard output and standard error that are closed, full, or not there."""

from __future__ import annotations

import os
import select
import sys
from contextlib import suppress
from io import TextIOWrapper
from typing import TextIO


def prepare_streams() -> None:
    """Make standard output and error take all that is printed.

    Where one of them was closed before the start it goes nowhere; otherwise ``print`` would write to standard output
    what is meant for standard error.  A character that their encoding lacks, as in the name of a folder, is written as
    an escape instead of ending the command.
    """
    if sys.stdout is None:
        sys.stdout = _nowhere()
    if sys.stderr is None:
        sys.stderr = _nowhere()
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")


def _nowhere() -> TextIO:
    return os.fdopen(os.open(os.devnull, os.O_WRONLY), "w", encoding="utf-8")


def output_is_closed() -> bool:
    """Whether nothing reads standard output or standard error any more, as after ``| head``."""
    if not hasattr(select, "poll"):  # Windows: what cannot be asked is taken for it
        return True
    waiting = select.poll()
    for stream in (sys.stdout, sys.stderr):
        with suppress(OSError, ValueError):  # as of a stream that is no file
            waiting.register(stream.fileno(), 0)
    return any(event & (select.POLLERR | select.POLLHUP) for _, event in waiting.poll(0))


def drop_output() -> None:
    """Send what is left of the output nowhere, so that the end of the process does not fail at it again."""
    for stream in (sys.stdout, sys.stderr):
        try:
            stream.flush()
        except OSError:
            with suppress(OSError):  # as of a stream that is no file
                nowhere = os.open(os.devnull, os.O_WRONLY)
                os.dup2(nowhere, stream.fileno())
                os.close(nowhere)
