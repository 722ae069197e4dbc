"""Rows of the tables of wrong input: what is wrong, what it gave before there were checks, and what names it."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

from validation.accuracy.wrong_input.draft import Draft
from validation.accuracy.wrong_input.verdicts import Verdict

Group = Literal["silent", "blamed"]
Change = Callable[[Draft], None]
BEAMS = ("cone", "parallel")
FAILED = "all grains not converged, each one blamed"
"""What came of most of the inputs that failed."""
ROWS: dict[str, Row] = {}
"""All rows by name, in the order of the modules that define them."""


@dataclass(frozen=True)
class Row:
    """One input that is wrong.

    Attributes
    ----------
    name : str
        Short name, for the command line and the results on disk.
    group : {"silent", "blamed"}
        Whether it gave wrong motions without a word, or failures blamed on the grains.
    text, before : str
        What is wrong, and what came of it before.
    cause : str
        Regular expression that a finding which names the cause matches.
    told_by : str
        The check, and the key or fix, for the table.
    make : callable
        Puts the mistake into a right experiment.
    beams : tuple of str
        Beams in which it is a mistake.
    of_state : bool
        Whether it leaves the reference and its files alone, so that these can be shared.
    """

    name: str
    group: Group
    text: str
    before: str
    cause: str
    told_by: str
    make: Change
    beams: tuple[str, ...] = BEAMS
    of_state: bool = False

    def seeds(self, count: int) -> list[int]:
        """The seeds of its samples; odd ones have a parallel beam."""
        step = 1 if len(self.beams) > 1 else 2
        first = 1 if self.beams == ("parallel",) else 0
        return list(range(first, first + step * count, step))

    def named(self, verdict: Verdict) -> bool:
        """Whether a finding names the cause."""
        return any(re.search(self.cause, line, re.IGNORECASE) for line in verdict.lines)


def row(
    group: Group,
    text: str,
    *,
    before: str,
    cause: str,
    told_by: str,
    beams: tuple[str, ...] = BEAMS,
    of_state: bool = False,
) -> Callable[[Change], Change]:
    """Decorator: register a change of a draft under its own name."""

    def register(make: Change) -> Change:
        name = make.__name__.replace("_", "-")
        ROWS[name] = Row(name, group, text, before, cause, told_by, make, beams, of_state)
        return make

    return register
