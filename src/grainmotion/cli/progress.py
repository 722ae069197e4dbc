"""Progress on standard error: a bar on a terminal, elsewhere a log, line by line.

Findings are shown as they come, above the bar or as lines of the log.
"""

from __future__ import annotations

import os
import re
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING

from grainmotion.cli.interrupts import Stop
from grainmotion.cli.log_listener import Say, shown
from grainmotion.cli.terminal import Terminal, styled
from grainmotion.cli.time_left import TimeLeft

if TYPE_CHECKING:
    from grainmotion._typing import Progress
    from grainmotion.model.finding import Finding

Show = Callable[[Terminal, Sequence[str]], Iterator[tuple["Progress", Say]]]


@contextmanager
def progress(
    terminal: Terminal, stop: Stop, states: Sequence[str] = (), found: list[Finding] | None = None
) -> Iterator[Progress]:
    """A listener for ``progress``; ``states`` are the names of the states to come, ``found`` collects findings.

    An interrupt that was lost inside a callback of a compiler or library is raised again at the next report.
    """
    show = contextmanager(_silence if terminal.quiet else _bar if _draws_bars() else _log)
    with show(terminal, states) as (listen, say), shown(say, terminal, [] if found is None else found):

        def listen_or_stop(message: str, done: int, total: int) -> None:
            stop.check()
            listen(message, done, total)

        yield listen_or_stop


def _draws_bars() -> bool:
    """Whether standard error can move its cursor."""
    return sys.stderr.isatty() and os.environ.get("TERM") != "dumb"


def _silence(terminal: Terminal, _states: Sequence[str]) -> Iterator[tuple[Progress, Say]]:
    yield (lambda _message, _done, _total: None), terminal.note


def _bar(terminal: Terminal, states: Sequence[str]) -> Iterator[tuple[Progress, Say]]:
    from rich.progress import BarColumn, TextColumn, TimeElapsedColumn
    from rich.progress import Progress as Bar

    left = TimeLeft(states)
    columns = (
        TextColumn("{task.description}", markup=False),
        BarColumn(bar_width=24),
        TimeElapsedColumn(),
        TextColumn("{task.fields[left]}", markup=False, style="dim"),
    )
    above = sys.stdout.isatty()  # lines of standard output stand above the bar, but those for a file go there
    console = terminal.console(stderr=True)
    with Bar(*columns, console=console, transient=True, redirect_stdout=above) as bar:
        task = bar.add_task("", total=None, left="")

        def listen(message: str, done: int, total: int) -> None:
            text = left.after(message, done, total)
            bar.update(task, description=message, completed=done, total=total, left=text)

        def say(message: str) -> None:  # rich draws the bar again below
            bar.console.print(styled(message, bar.console.width))

        yield listen, say


def _log(terminal: Terminal, _states: Sequence[str]) -> Iterator[tuple[Progress, Say]]:
    """Print the last message of each step, which carries its outcome."""
    last = [""]

    def step(message: str) -> str:
        return re.split(r", ε|: residual", message)[0]

    def tell() -> None:
        if last[0]:
            print(last[0], file=sys.stderr, flush=True)

    def listen(message: str, done: int, total: int) -> None:
        if step(message) != step(last[0]):
            tell()
        last[0] = message

    try:
        yield listen, terminal.note
    finally:
        tell()
