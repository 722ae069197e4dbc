"""The states of a watch: what of each has arrived, and how its tracking went."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path
from typing import Literal

import numpy as np

from grainmotion.errors import InputError
from grainmotion.experiment.arrivals import Snapshot, snapshot
from grainmotion.experiment.config import Experiment, watched_folders
from grainmotion.experiment.scan_inputs import ScanInput
from grainmotion.experiment.scan_tables import StateTable
from grainmotion.experiment.watched_folders import ordered_folders
from grainmotion.model.motions import Motions
from grainmotion.report.watch_page import WatchRow

Phase = Literal["waiting", "arriving", "complete", "tracking", "tracked", "refused", "error"]
DONE: tuple[Phase, ...] = ("tracked", "refused")
RETRY_SECONDS = 30.0
"""Time after which a state is read again where a drive or disk failed."""
NOTHING_YET = Snapshot(frozenset(), 0)


@dataclass(eq=False)
class WatchedState:
    """One state of a watch.

    ``seen`` is the last look at its files and ``used`` the one from which it was last read; ``source`` and ``start``
    are what was read, None while it is not complete or cannot be used.
    """

    table: StateTable
    phase: Phase = "waiting"
    message: str = ""
    seen: Snapshot = NOTHING_YET
    used: Snapshot | None = None
    source: ScanInput | None = None
    start: Motions | None = None
    motions: Motions | None = None
    seconds: float | None = None  # from its last radiograph to its motions
    tracking_seconds: float | None = None
    not_before: float = 0.0  # time from which it may be read
    same: bool = False  # whether the last two looks saw the same
    last_change: float = field(default_factory=time.monotonic)
    last_arrival: datetime | None = None

    def look(self, now: Snapshot) -> bool:
        """Take a look at its files; whether they changed."""
        changed, self.seen = now != self.seen, now
        self.same = not changed
        if changed and now.files:
            self.last_change, self.last_arrival = time.monotonic(), datetime.now().astimezone()
        if changed and self.phase in ("waiting", "arriving", "error"):
            self.phase, self.message = ("arriving" if now.files else "waiting"), now.missing if now.files else ""
        return changed

    @property
    def settled(self) -> bool:
        """Whether its files are all there, the same at two looks, and have not been read as they are now."""
        if not self.same or not self.seen.files or self.seen.missing or time.monotonic() < self.not_before:
            return False
        return self.seen != self.used and not self.moved_away

    @property
    def moved_away(self) -> bool:
        """Whether it is tracked and some of its files are gone, as to an archive, with none new or changed."""
        return self.motions is not None and self.used is not None and self.seen.files < self.used.files

    def try_again(self, message: str) -> None:
        """Read it again after a while, though its files may not change."""
        self.used, self.message, self.not_before = None, message, time.monotonic() + RETRY_SECONDS

    def line(self) -> str:
        """What the terminal shows once it is tracked."""
        if self.motions is None or self.phase == "refused":
            return f"{self.table.name}: {self.phase}: {self.message}"
        length, grain = largest_displacement(self.motions)
        parts = [f"{self.table.name}: {self.motions.counts} usable", status_counts(self.motions)]
        if grain:
            parts.append(f"largest displacement {length:.4g} mm (grain {grain})")
        parts.append(f"mean residual {mean_residual(self.motions):.3g}")
        if self.seconds is not None:
            parts.append(f"{self.seconds:.1f} s after its last radiograph")
        return "; ".join(parts)

    def row(self) -> WatchRow:
        """What the live page shows of it."""
        files = f"{self.seen.radiographs} file{'s' * (self.seen.radiographs != 1)}"
        counts, usable, residual, largest, grain = "", "", float("nan"), float("nan"), ""
        if self.motions is not None:
            counts, usable = status_counts(self.motions), self.motions.counts
            residual = mean_residual(self.motions)
            largest, grain = largest_displacement(self.motions)
        return WatchRow(
            self.table.name, self.phase, self.message, files, self.last_arrival, counts, usable, residual, largest,
            grain, self.seconds, self.tracking_seconds,
        )  # fmt: skip


def status_counts(motions: Motions) -> str:
    """How many grains have each status, as ``98 converged, 2 ambiguous``."""
    statuses, counts = np.unique(motions.statuses, return_counts=True)
    return ", ".join(f"{counts[k]} {statuses[k]}" for k in np.argsort(-counts, kind="stable"))


def mean_residual(motions: Motions) -> float:
    """Mean of the grains' residuals, NaN if none is known."""
    known = motions.residuals[np.isfinite(motions.residuals)]
    return float(known.mean()) if len(known) else float("nan")


def largest_displacement(motions: Motions) -> tuple[float, str]:
    """The longest translation that is a result to use, mm, and the label of its grain."""
    lengths = np.where(motions.ok_translation, np.linalg.norm(motions.translations, axis=1), np.nan)
    if not np.isfinite(lengths).any():
        return float("nan"), ""
    k = int(np.nanargmax(lengths))
    return float(lengths[k]), str(motions.labels[k])


class WatchList:
    """The states of an experiment, in order: those of its file, and of the folders that appear."""

    def __init__(self, experiment: Experiment) -> None:
        self.experiment = experiment
        listed = [table for table in experiment.tables.states if table.name not in experiment.of_folders]
        self.listed = [WatchedState(table) for table in listed]
        self.found: dict[str, WatchedState] = {}
        self.folders: dict[str, Path] = {}
        self.states: list[WatchedState] = list(self.listed)
        self.notes: list[str] = []  # on folders that cannot be states

    def look(self) -> bool:
        """Look for new folders and at all files; whether anything changed."""
        changed = self._find_folders()
        for state in self.states:
            changed |= state.look(snapshot(state.table, self.experiment.folder))
        return changed

    def _find_folders(self) -> bool:
        """Add a state for each new folder, in the order of the numbers in the names; whether there were any."""
        watched = self.experiment.tables.watch
        if watched is None:
            return False
        names, notes, before = list[str](), list[str](), set(self.found)
        try:
            folders = watched_folders(self.experiment)
        except InputError as error:
            changed, self.notes = self.notes != [str(error)], [str(error)]
            return changed
        gone = [
            self.folders[name] for name, state in self.found.items() if state.motions is not None
        ]  # their results stay
        for folder in ordered_folders({*folders, *gone}):
            taken = [*names, *(state.table.name for state in self.listed)]
            try:
                table = watched.state(folder, taken)
                if folder.name not in self.found:
                    self.found[folder.name], self.folders[folder.name] = WatchedState(table), folder
                names.append(folder.name)
            except InputError as error:
                notes.append(str(error))
        self.states = [*self.listed, *(self.found[name] for name in names)]
        changed, self.notes = notes != self.notes, notes
        return changed or set(self.found) != before

    @property
    def can_grow(self) -> bool:
        """Whether folders may still become states."""
        return self.experiment.tables.watch is not None


def in_order(states: Sequence[WatchedState]) -> list[tuple[StateTable, ScanInput, Motions | None]]:
    """Those of the states that are complete and can be used, as `RunContext.set_states` wants them."""
    return [(state.table, state.source, state.start) for state in states if state.source is not None]
