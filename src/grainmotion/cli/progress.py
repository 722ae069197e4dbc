"""Progress on standard error: a bar on a terminal, elsewhere a log, line by line.

Findings are shown as they come, above the bar or as lines of the log.
"""

from __future__ import annotations

import os
import re
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING

from grainmotion.cli.compiling import COMPILING, compilation_told
from grainmotion.cli.interrupts import Stop
from grainmotion.cli.log_listener import Say, shown
from grainmotion.cli.terminal import Terminal, styled
from grainmotion.cli.time_left import TimeLeft
from grainmotion.model.progress import listening, without_detail

if TYPE_CHECKING:
    from grainmotion._typing import Progress
    from grainmotion.model.finding import Finding

Shown = tuple["Progress", Say, Callable[[], None]]
"""What to call with reports, with lines that are to stay, and when the compiler begins something."""
Show = Callable[[Terminal, Sequence[str]], Iterator[Shown]]


LOG_SECONDS = 30.0
"""Seconds after which a step that still goes on has a line in a log."""


@contextmanager
def progress(
    terminal: Terminal, stop: Stop, states: Sequence[str] = (), found: list[Finding] | None = None
) -> Iterator[Progress]:
    """A listener for ``progress``; ``states`` are the names of the states to come, ``found`` collects findings.

    An interrupt that was lost inside a callback of a compiler or library is raised again at the next report.
    """
    show = contextmanager(_silence if terminal.quiet else _bar if _draws_bars() else _log)
    with show(terminal, states) as (listen, say, compiling), shown(say, terminal, [] if found is None else found):

        def listen_or_stop(message: str, done: int, total: int) -> None:
            stop.check()
            listen(message, done, total)

        def compiling_or_stop() -> None:
            stop.check()
            compiling()

        with listening(listen_or_stop) as listener, compilation_told(compiling_or_stop):
            assert listener is not None
            yield listener


def _draws_bars() -> bool:
    """Whether standard error can move its cursor."""
    return sys.stderr.isatty() and os.environ.get("TERM") != "dumb"


def _silence(terminal: Terminal, _states: Sequence[str]) -> Iterator[Shown]:
    yield (lambda _message, _done, _total: None), terminal.note, (lambda: None)


def _bar(terminal: Terminal, states: Sequence[str]) -> Iterator[Shown]:
    from rich.progress import BarColumn, ProgressColumn, SpinnerColumn, TextColumn, TimeElapsedColumn
    from rich.progress import Progress as Bar
    from rich.text import Text

    left = TimeLeft(states)

    class Left(ProgressColumn):
        """The time left, counted down while nothing is reported."""

        max_refresh = 0.5

        def render(self, _task: object) -> Text:
            return Text(left.now(), style="dim")

    columns = (
        SpinnerColumn(),
        TextColumn("{task.description}", markup=False),
        BarColumn(bar_width=24),
        TextColumn("{task.fields[share]}"),
        TimeElapsedColumn(),
        Left(),
    )
    above = sys.stdout.isatty()  # lines of standard output stand above the bar, but those for a file go there
    console = terminal.console(stderr=True)
    with Bar(*columns, console=console, transient=True, redirect_stdout=above) as bar:
        task = bar.add_task("", total=None, share="", visible=False)
        text, told = "", False

        def listen(message: str, done: int, total: int) -> None:
            nonlocal text
            text = message
            left.after(message, done, total)
            bar.update(
                task,
                description=message or "starting",
                completed=done,
                total=total,
                share=_share(done, total),
                visible=True,
            )

        def say(message: str) -> None:  # rich draws the bar again below
            bar.console.print(styled(message, bar.console.width))

        def compiling() -> None:
            nonlocal told
            if not told:
                say(COMPILING)
            told = True
            bar.update(task, description=f"{text} (compiling)".lstrip(), visible=True)

        yield listen, say, compiling


def _share(done: int, total: int) -> str:
    """The share of a stage that is done, in as many columns always."""
    return f"{done / total:4.0%}" if total > 0 else ""


def _log(terminal: Terminal, states: Sequence[str]) -> Iterator[Shown]:
    """Print the last message of each step, which carries its outcome; one that takes long now and then, with its share.

    Reports come at least every few seconds, so that a line is late by no more.
    """
    left, last, printed, told = TimeLeft(states), [""], [time.monotonic()], [False]

    def step(message: str) -> str:
        return re.split(r", ε|: residual", without_detail(message))[0]

    def tell(more: str = "") -> None:
        line = without_detail(last[0])
        if line:  # the work has begun a step
            print(line + more, file=sys.stderr, flush=True)
            printed[0] = time.monotonic()

    def listen(message: str, done: int, total: int) -> None:
        text = left.after(message, done, total)
        if step(message) != step(last[0]):
            tell()
        last[0] = message
        if time.monotonic() - printed[0] > LOG_SECONDS:
            tell(" ... " + ", ".join(part for part in (_share(done, total).strip(), text) if part))

    def compiling() -> None:
        if not told[0]:
            terminal.note(COMPILING)
        told[0] = True

    try:
        yield listen, terminal.note, compiling
    finally:
        tell()
