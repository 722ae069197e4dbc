"""Standard output and standard error: what goes where, in which colours, and how much of it.

Standard output has what was asked for: tables, states, paths, or one JSON document.  Progress, findings as they come
and errors go to standard error, so that ``grainmotion run … > results.txt`` and ``--json | jq`` get results alone.
"""

from __future__ import annotations

import os
import sys
import textwrap
from dataclasses import dataclass
from typing import TYPE_CHECKING, TextIO

if TYPE_CHECKING:
    from rich.console import Console
    from rich.text import Text

MIN_WIDTH = 80  # columns of the narrowest terminal that lines are wrapped for
LOG_WIDTH = 120  # columns of tables that go to a file or another program
LEVEL_STYLES = {"error": "bold red", "warning": "yellow", "note": "cyan"}


@dataclass(frozen=True)
class Terminal:
    """How a command talks: as text or JSON, how much, and whether in colour.

    ``auto`` is colour on a terminal; the variables ``NO_COLOR`` and ``FORCE_COLOR`` of the environment change that,
    and ``always`` and ``never`` replace them.
    """

    json: bool = False
    quiet: bool = False
    verbose: bool = False
    color: str = "auto"  # or "always", "never"

    def console(self, *, stderr: bool = False, log_width: int = LOG_WIDTH) -> Console:
        """A console on one of the streams; ``log_width`` is that of tables that go to no terminal."""
        from rich.console import Console

        stream = sys.stderr if stderr else sys.stdout
        width = None if stream.isatty() else log_width
        if self.color == "always":  # whatever the environment says
            console = Console(stderr=stderr, width=width, force_terminal=True, color_system="standard", highlight=False)
            console.no_color = False
            return console
        if self.color == "never" or os.environ.get("NO_COLOR"):  # without colours there are no bold letters either
            return Console(stderr=stderr, width=width, color_system=None, highlight=False)
        return Console(stderr=stderr, width=width, highlight=False)

    def say(self, message: str) -> None:
        """A result: a line on standard output, on standard error where that has a JSON document."""
        self.message(message, stderr=self.json)

    def note(self, message: str) -> None:
        """What is worth knowing while the work goes on: a line on standard error."""
        self.message(message, stderr=True)

    def message(self, message: str, *, stderr: bool = False) -> None:
        """A message that may begin with its level: in wrapped lines on a terminal, as one line elsewhere."""
        stream: TextIO = sys.stderr if stderr else sys.stdout
        level = message.partition(":")[0]
        if level not in LEVEL_STYLES and not stream.isatty():
            print(message, file=stream, flush=True)
            return
        console = self.console(stderr=stderr)
        text = styled(message, console.width) if stream.isatty() else colored(message)
        with console.capture() as rendered:
            console.print(text, soft_wrap=True)
        print(rendered.get(), end="", file=stream, flush=True)  # a bar that is drawn stays below it


def styled(message: str, width: int) -> Text:
    """A message that begins with its level, in lines of ``width`` columns with the level in colour."""
    lines = textwrap.fill(message, max(width, MIN_WIDTH) - 1, subsequent_indent="  ", break_on_hyphens=False)
    return colored(lines)


def colored(message: str) -> Text:
    """A message with the level at its beginning in colour."""
    from rich.text import Text

    level, colon, _ = message.partition(":")
    text = Text(message)
    if level in LEVEL_STYLES:
        text.stylize(LEVEL_STYLES[level], 0, len(level + colon))
    return text
