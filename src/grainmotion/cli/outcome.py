"""What a command hands back: a record for machines, the same as text for people, and how it ended."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from grainmotion.cli.exit_codes import BAD_INPUT, NO_RESULT, SUCCESS
from grainmotion.cli.terminal import Terminal
from grainmotion.model.finding import Finding, Level

if TYPE_CHECKING:
    from grainmotion.cli.documents import Document
    from grainmotion.model.motions import Motions


@dataclass(frozen=True)
class Ending:
    """Exit code, and a sentence where it is not that of a success."""

    code: int = SUCCESS
    reason: str = ""


@dataclass(frozen=True, eq=False)
class Outcome:
    """Outcome of a command that was carried out."""

    document: Document
    show: Callable[[Terminal], None]
    findings: tuple[Finding, ...] = ()
    ending: Ending = Ending()


def ending_by(motions: dict[str, Motions], findings: Iterable[Finding], *, strict: bool) -> Ending:
    """`NO_RESULT` if a state has no usable grain, or at a warning if ``strict``."""
    empty = [name for name, m in motions.items() if not m.usable.any()]
    serious = [f for f in findings if f.level is not Level.NOTE]
    if empty:
        return Ending(NO_RESULT, f"no grain of {', '.join(empty)} is usable")
    if strict and serious:
        count = f"{len(serious)} warnings or errors" if len(serious) > 1 else f"one {serious[0].level}"
        return Ending(NO_RESULT, f"{count}, and --strict is given")
    return Ending()


def ending_of_inspection(findings: tuple[Finding, ...], *, strict: bool) -> Ending:
    """`BAD_INPUT` if a run would stop at a finding, else as after a run."""
    if any(f.level is Level.ERROR for f in findings):
        return Ending(BAD_INPUT, "`grainmotion run` would stop there")
    return ending_by({}, findings, strict=strict)
