"""How a run ended, for people: the states, the grains that need a look in a few lines, and where results are."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING

from grainmotion.cli.terminal import Terminal
from grainmotion.model.finding import Finding, Level

if TYPE_CHECKING:
    from grainmotion.model.motions import Motions
    from grainmotion.workflow.run import RunResult

MAX_GROUPS = 12
"""Groups of grains that are told, of all states; the report has all."""
MAX_LABELS = 10
"""Grains that are named of each group."""


def print_run(terminal: Terminal, result: RunResult, lines: Iterable[str] = ()) -> None:
    """Print stages, states, all findings again, ``lines``, and where results are."""
    if not terminal.quiet:
        kept = ", ".join(result.reused) or "nothing"
        terminal.message(f"done: {', '.join(result.done) or 'nothing'}; kept: {kept}")
    print_states(terminal, result.motions)
    print_findings(terminal, result.findings)
    for line in (*lines, *places(result)):
        print(line)


def places(result: RunResult) -> Iterable[str]:
    """The report, the tables and the log, by their paths."""
    from grainmotion.workflow.log import RUN_LOG

    states = list(result.motions)
    if result.report is not None:
        yield f"report: {result.report}"
    if states:
        each = states[0] if len(states) == 1 else "STATE"
        series = result.folder / "series.csv"
        of_all = f", of all states: {series}" if result.report is not None and series.is_file() else ""
        yield f"tables: {result.folder / each / 'motions.csv'}{of_all}"
    if (result.folder / RUN_LOG).is_file():
        yield f"log: {result.folder / RUN_LOG}"


def print_findings(terminal: Terminal, findings: Iterable[Finding]) -> None:
    """Print findings in their order; notes only if not quiet."""
    for finding in findings:
        if not (terminal.quiet and finding.level is Level.NOTE):
            terminal.message(finding.line)


def print_states(terminal: Terminal, motions: Mapping[str, Motions]) -> None:
    """Print how the tracking of each state went: a table, what else moved, and the grains that need a look."""
    import numpy as np
    from rich.markup import escape

    from grainmotion.cli.tables import print_within
    from grainmotion.report.tables import scene_sentences

    if not motions:
        return
    names = "state", "grains", "converged", "translations", "rotations", "others", "median |u| (mm)", "median |w| (deg)"
    rows = []
    for name, m in motions.items():
        statuses, counts = np.unique(m.statuses[~m.ok], return_counts=True)
        others = ", ".join(f"{n} {status}" for status, n in zip(statuses, counts))
        u = np.linalg.norm(m.translations[m.ok_translation], axis=1)
        w = np.rad2deg(np.linalg.norm(m.rotations[m.ok_rotation], axis=1))
        medians = [f"{np.median(v):.4g}" if len(v) else "-" for v in (u, w)]
        counted = str(len(m)), str(int(m.ok.sum())), str(len(u)), str(len(w))
        rows.append((escape(name), *counted, others or "-", *medians))
    print_within(terminal.console(), names, rows)
    for name, m in motions.items():
        for sentence in scene_sentences(m.fit):
            terminal.message(f"{name}: {sentence}")
    lines = grains_to_look_at(motions)
    for line in lines[:MAX_GROUPS]:
        terminal.message(line)
    if len(lines) > MAX_GROUPS:
        print(f"... and {len(lines) - MAX_GROUPS} more groups of grains, in the report")


def grains_to_look_at(motions: Mapping[str, Motions]) -> list[str]:
    """A line for the grains of each state that are not as they should be for alike reasons.

    Grains of one status are one group, whatever numbers are in their reasons; the reason of the first is told.  Grains
    that failed with nearly all others are left out, since a finding tells their common cause.
    """
    from grainmotion.diagnosis.results import SEE_COMMON_CAUSE

    lines = []
    for name, m in motions.items():
        groups: dict[str, list[tuple[int, str]]] = {}
        for label, status, reason, ok in zip(m.labels, m.statuses, m.reasons, m.ok, strict=True):
            if not ok and not reason.startswith(SEE_COMMON_CAUSE):
                groups.setdefault(str(status), []).append((int(label), reason))
        lines += [_line(name, status, grains) for status, grains in groups.items()]
    return lines


def _line(state: str, status: str, grains: list[tuple[int, str]]) -> str:
    """The line about grains of one state and status."""
    labels, reasons = [label for label, _ in grains], {reason for _, reason in grains}
    more = f" and {len(labels) - MAX_LABELS} more" if len(labels) > MAX_LABELS else ""
    which = f"grain{'s' * (len(labels) > 1)} {', '.join(map(str, labels[:MAX_LABELS]))}{more}"
    label, reason = grains[0]
    if not reason:
        return f"{state}, {which}: {status}"
    if len(reasons) == 1:
        return f"{state}, {which}: {status}: {reason}"
    return f"{state}, {which}: {status}; of grain {label}: {reason}"
