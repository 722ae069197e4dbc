"""What the package logs while it works, shown on the terminal as it comes: findings, warnings, details of stages."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from grainmotion.cli.terminal import Terminal

if TYPE_CHECKING:
    from grainmotion.model.finding import Finding

LOGGER = "grainmotion"
Say = Callable[[str], None]


class _Listener(logging.Handler):
    """Hands each finding that is logged, and every other warning of the package, to a function."""

    def __init__(self, say: Say, terminal: Terminal, found: list[Finding]) -> None:
        super().__init__(logging.INFO)
        self.say, self.terminal, self.found = say, terminal, found

    def emit(self, record: logging.LogRecord) -> None:
        """Show the record; what is only for the log file of a run is shown if details are wanted."""
        finding: Finding | None = getattr(record, "finding", None)
        if finding is not None:
            self.found.append(finding)
        if record.name != LOGGER and not self.terminal.verbose:
            return
        if record.levelno >= logging.WARNING or not self.terminal.quiet:
            self.say(record.getMessage())


@contextmanager
def shown(say: Say, terminal: Terminal, found: list[Finding]) -> Iterator[None]:
    """Show findings as they are logged, notes only if not quiet; ``found`` collects them all."""
    logger = logging.getLogger(LOGGER)
    before = logger.level
    listener = _Listener(say, terminal, found)
    logger.addHandler(listener)
    logger.setLevel(logging.INFO)
    try:
        yield
    finally:
        logger.removeHandler(listener)
        logger.setLevel(before)
