"""What a run would do, without doing it: which stages are kept, which are done, and why.

The stages are those of `workflow.run`: the same functions build them, and `PlannedRun` notes them instead of completing
them.  Nothing is written, and no file is read but headers, and files that changed since they were last used.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

import numpy as np

from grainmotion import __version__
from grainmotion.experiment.config import Experiment
from grainmotion.experiment.inputs import find_inputs
from grainmotion.io.files import checked_folder
from grainmotion.model.finding import Finding, Level
from grainmotion.model.motions import Motions
from grainmotion.workflow.calibration_stage import calibrate_stage
from grainmotion.workflow.context import RunContext
from grainmotion.workflow.fingerprints import Fingerprints
from grainmotion.workflow.outputs import REPORT, SERIES, write_outputs
from grainmotion.workflow.provenance import Stage, StageCache
from grainmotion.workflow.reference_stages import reconstruct_stage, segment_stage
from grainmotion.workflow.run import check_formats, check_overwriting
from grainmotion.workflow.tracking_stage import TrackedState, load_state

if TYPE_CHECKING:
    from collections.abc import Callable

    from grainmotion.workflow.reference_stages import SegmentedReference
    from grainmotion.workflow.run import Until

MAX_NAMED_FILES = 3
"""Changed files that are named of a stage."""
REFUSED_BEFORE, SEE_LOG = "an earlier run refused it", "see its finding in the report or in run.log"
T = TypeVar("T")


@dataclass(frozen=True)
class PlannedStage:
    """A stage of a run: whether it is kept and, if not, why it is done."""

    name: str
    kept: bool
    why: str = ""


class PlannedCache(StageCache):
    """The finished stages; where there are none, no file is read, since nothing can be kept."""

    def _content(self, path: Path) -> str:
        return super()._content(path) if self.made_by else f"new: {path}"

    def _save(self) -> None:
        raise AssertionError("a dry run writes nothing")


@dataclass(eq=False)
class PlannedRun(RunContext):
    """A run whose stages are noted, not completed."""

    planned: list[PlannedStage] = field(default_factory=list)
    again: dict[str, str] = field(default_factory=dict)  # names of the stages that are done, by their fingerprint

    def complete(self, stage: Stage[T]) -> Callable[[], T]:
        """Note a stage; what it would make can be had only if it is there already."""
        kept = self.cache.is_done(stage.name, stage.fingerprint)
        self.note(stage.name, stage.fingerprint, kept=kept)
        return stage.load

    def note(self, name: str, fingerprint: str, *, kept: bool) -> None:
        """Note a stage by its name and fingerprint."""
        if not kept:
            self.again[fingerprint] = name
        self.planned.append(PlannedStage(name, kept, "" if kept else self.why(name, fingerprint)))

    def why(self, name: str, fingerprint: str) -> str:
        """Why a stage is not kept."""
        if not self.cache.has(name):
            return "not done yet"
        if self.cache.is_recorded(name, fingerprint):
            gone = [file.name for file in self.cache.files(name) if not file.is_file()]
            return f"{_names(gone)} {'is' if len(gone) == 1 else 'are'} gone"
        if self.cache.made_by not in ("", __version__):
            return f"it was done by version {self.cache.made_by}"
        changed, upstream = self.cache.made_from(fingerprint)
        if changed:
            return f"{_names([path.name for path in changed])} changed"
        before = [self.again[one] for one in upstream if one in self.again]
        return f"{before[0]} is done again" if before else "its settings changed"


def _names(names: list[str]) -> str:
    more = f" and {len(names) - MAX_NAMED_FILES} more" if len(names) > MAX_NAMED_FILES else ""
    return ", ".join(names[:MAX_NAMED_FILES]) + more


def planned_run(experiment: Experiment, *, out: Path | None = None, until: Until = "report") -> PlannedRun:
    """The stages that ``run`` with the same arguments would do and keep.

    Parameters
    ----------
    experiment : Experiment
        A file read by `read_experiment`.
    out : Path, optional
        Folder of the results; by default ``[output] directory``.
    until : {"reconstruct", "segment", "track", "report"}
        The last stage.

    Returns
    -------
    PlannedRun
        Its ``planned`` are the stages in their order.

    Raises
    ------
    InputError
        If an input is missing or cannot be used by its header.
    """
    check_formats(experiment)
    inputs = find_inputs(experiment)
    folder = checked_folder(out if out is not None else experiment.output)
    check_overwriting(inputs, folder)
    context = PlannedRun(experiment, inputs, folder, PlannedCache(folder))
    calibrate_stage(context)
    reconstruction = reconstruct_stage(context)
    if until == "reconstruct":
        return context
    reference = segment_stage(context, reconstruction)
    if until == "segment":
        return context
    tracked = _plan_states(context)
    if until == "report":
        _plan_outputs(context, reference, tracked)
    return context


def _plan_states(context: PlannedRun) -> dict[str, TrackedState]:
    """Note the tracking of all states; returns the motions of those that are kept, and others without any grain."""
    nothing = Motions.identity(np.zeros(0, dtype=np.int64), np.zeros((0, 3)))
    tracked = {}
    for table, source in context.states:
        name = f"{table.name}/track"
        refused = frozenset({*context.refused, table.name})
        as_refused = Fingerprints(context.experiment, context.inputs, context.cache, refused).tracks[table.name]
        if context.cache.is_done(name, as_refused):  # and would be again
            context.refuse(table.name, Finding(Level.ERROR, "fit", source.key, REFUSED_BEFORE, remedy=SEE_LOG))
        fingerprint = context.fingerprints.tracks[table.name]
        kept = context.cache.is_done(name, fingerprint)
        context.note(name, fingerprint, kept=kept)
        tracked[table.name] = load_state(context, table) if kept else TrackedState(nothing)
    return tracked


def _plan_outputs(
    context: PlannedRun, reference: Callable[[], SegmentedReference], tracked: Mapping[str, TrackedState]
) -> None:
    """Note what is written beside the motions.

    Whether the report is kept depends on findings that only a run makes again: it is if all that it shows is kept.
    """
    write_outputs(context, reference, tracked)
    shown = [s for s in context.planned if s.name.endswith("/track") or s.name in ("reconstruct", "segment")]
    shown += [s for s in context.planned if s.name.startswith(f"{SERIES}/")]
    again = [stage.name for stage in shown if not stage.kept]
    there = context.cache.has("report") and (context.folder / REPORT).is_file()
    why = "" if there and not again else "not done yet" if not there else f"{again[0]} is done again"
    context.planned.append(PlannedStage("report", not why, why))
