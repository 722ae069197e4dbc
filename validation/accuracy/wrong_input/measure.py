"""Measuring: all trials that have no verdict yet, one seed after the other, so that a part of them is worth reading."""

from __future__ import annotations

import traceback
from collections.abc import Iterable, Sequence

from validation.accuracy import page
from validation.accuracy.wrong_input import (
    given_rows,
    reference_rows,
    scan_rows,
    state_rows,
)  # they register their rows
from validation.accuracy.wrong_input.good_cases import GOOD_CASES
from validation.accuracy.wrong_input.rows import ROWS, Row
from validation.accuracy.wrong_input.trial import good, load, package_digest, save, store, wrong
from validation.accuracy.wrong_input.verdicts import Verdict
from validation.common.trials import run_trials

MODULES = (scan_rows, given_rows, state_rows, reference_rows)
"""Those that register rows, in the order of the tables."""
SEEDS = 20
QUICK = {
    *("first-row-not-given", "end-point-counted", "virtual-member-missing", "settings-misspelled"),
    *("volume-xyz", "volume-upside-down", "labels-flipped", "volume-8-bit", "volume-16-bit", "volume-small"),
    *("reference-radians", "reference-black", "saturated", "offset-32768"),
    *(name for name, row in ROWS.items() if row.of_state),
}
"""Rows that are judged within a second."""
Job = tuple[str, str, int]
"""Kind (``wrong`` or ``good``), name and seed."""


def rows() -> list[Row]:
    """All rows, in the order of the tables."""
    names = [module.__name__ for module in MODULES]
    return sorted(ROWS.values(), key=lambda row: names.index(row.make.__module__))


def jobs(names: Sequence[str] = (), seeds: int = SEEDS) -> list[Job]:
    """All trials, or those of some names, in the order of their seeds; those that take long, later."""
    found = [("wrong", row.name, seed) for row in rows() for seed in row.seeds(seeds)]
    found += [("good", name, seed) for name, case in GOOD_CASES.items() for seed in range(min(case.seeds, seeds))]
    return sorted(
        (j for j in found if not names or j[1] in names),
        key=lambda j: j[2] + 2 if j[1] in QUICK else 2 * j[2] + 1 if j[0] == "good" else j[2],
    )


def outdated(wanted: Iterable[Job]) -> list[Job]:
    """Trials without a verdict on the package as it is now."""
    return [job for job in wanted if not store(*job).exists() or load(store(*job)).source != package_digest()]


def missing(wanted: Iterable[Job]) -> list[Job]:
    """Trials without any verdict."""
    return [job for job in wanted if not store(*job).exists()]


def measure(wanted: Iterable[Job]) -> None:
    """Judge; the trials of a seed in one process, as they share files."""
    left: dict[tuple[str, bool, int], list[Job]] = {}
    for job in wanted:
        left.setdefault((job[0], job[1] in QUICK, job[2]), []).append(job)
    run_trials(some, list(left.values()), page.PROCESSES)


def some(left: list[Job]) -> int:
    """Judge trials and keep their verdicts; one that breaks is told and left out."""
    for kind, name, seed in left:
        try:
            save(store(kind, name, seed), wrong(name, seed) if kind == "wrong" else good(name, seed))
        except Exception:  # of whatever kind: a traceback is an outcome, too
            text = traceback.format_exc()
            save(store(kind, name, seed), Verdict([f"traceback: {text}"], True, 0, 0, 0, 0, (0.0, 0.0), 0.0))
    return len(left)


def verdicts(kind: str, name: str) -> dict[int, Verdict]:
    """Verdicts that are on disk, by seed."""
    return {int(f.stem): load(f) for f in sorted(store(kind, name, 0).parent.glob("*.json"), key=lambda f: int(f.stem))}
