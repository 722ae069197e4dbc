"""Findings on the terminal: each as it comes, all again at the end, and the exit code that they lead to."""

from __future__ import annotations

import logging
import sys
import textwrap
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

import typer
from rich.console import Console
from rich.text import Text

from grainmotion.model.finding import Finding, Level

if TYPE_CHECKING:
    from grainmotion.model.motions import Motions

BAD_INPUT = 2
"""Exit code if an input cannot be used."""
NO_RESULT = 3
"""Exit code if no grain of some state is usable, or if there is a warning and ``--strict`` is given."""
EXIT_CODES = (
    "Exit codes: 0 success; 1 out of memory, or a fault of the program; 2 an input or option cannot be used; "
    "3 no grain of some state is usable, or --strict and there is a warning; 130 interrupted."
)
LOGGER = "grainmotion"
MIN_WIDTH = 80  # columns of the narrowest terminal that lines are wrapped for
LEVEL_STYLES = {"error": "bold red", "warning": "yellow", "note": "cyan"}


class _Listener(logging.Handler):
    """Hands each finding that is logged, and every other warning of the package, to a function."""

    def __init__(self, show: Callable[[str], None], level: int) -> None:
        super().__init__(level)
        self.show = show

    def emit(self, record: logging.LogRecord) -> None:
        """Show the record, unless it is only for the log file of a run."""
        if record.name == LOGGER:
            self.show(record.getMessage())


@contextmanager
def shown(show: Callable[[str], None], *, quiet: bool) -> Iterator[None]:
    """Show findings as they are logged; notes only if not ``quiet``."""
    logger = logging.getLogger(LOGGER)
    before, level = logger.level, logging.WARNING if quiet else logging.INFO
    listener = _Listener(show, level)
    logger.addHandler(listener)
    logger.setLevel(logging.INFO)
    try:
        yield
    finally:
        logger.removeHandler(listener)
        logger.setLevel(before)


def styled(message: str, width: int) -> Text:
    """A message that begins with its level, in lines of ``width`` columns with the level in colour."""
    level, colon, _ = message.partition(":")
    lines = textwrap.fill(message, max(width, MIN_WIDTH) - 1, subsequent_indent="  ", break_on_hyphens=False)
    text = Text(lines)
    if level in LEVEL_STYLES:
        text.stylize(LEVEL_STYLES[level], 0, len(level + colon))
    return text


def print_message(message: str) -> None:
    """Print a message: in lines on a terminal, as one line in a log."""
    if sys.stdout.isatty():
        console = Console()
        console.print(styled(message, console.width), soft_wrap=True)
    else:
        print(message, flush=True)


def print_findings(findings: Iterable[Finding], *, quiet: bool = False) -> None:
    """Print findings in their order; notes only if not ``quiet``."""
    for finding in findings:
        if not (quiet and finding.level is Level.NOTE):
            print_message(finding.line)


def exit_by(motions: dict[str, Motions], findings: Iterable[Finding], *, strict: bool) -> None:
    """End the command with `NO_RESULT` if a state has no usable grain, or at a warning if ``strict``."""
    empty = [name for name, m in motions.items() if not m.usable.any()]
    serious = [f for f in findings if f.level is not Level.NOTE]
    if empty:
        print(f"exit code {NO_RESULT}: no grain of {', '.join(empty)} is usable", file=sys.stderr)
    elif strict and serious:
        count = f"{len(serious)} warnings or errors" if len(serious) > 1 else f"one {serious[0].level}"
        print(f"exit code {NO_RESULT}: {count}, and --strict is given", file=sys.stderr)
    else:
        return
    raise typer.Exit(NO_RESULT)


def exit_at_errors(findings: Iterable[Finding]) -> None:
    """End an inspection with `BAD_INPUT` if a run would stop at a finding."""
    if any(f.level is Level.ERROR for f in findings):
        print(f"exit code {BAD_INPUT}: `grainmotion run` would stop there", file=sys.stderr)
        raise typer.Exit(BAD_INPUT)
