"""Tracking the states of a run: from which motions each starts, and whether one process or workers track it."""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, replace

from grainmotion._typing import Image
from grainmotion.cluster.state_tasks import State
from grainmotion.cluster.team_tracking import TeamState
from grainmotion.diagnosis.labels import in_doubt
from grainmotion.diagnosis.results import common_cause, with_common_cause
from grainmotion.diagnosis.state_residual import residual_notes
from grainmotion.experiment.scan_inputs import ScanInput
from grainmotion.experiment.scan_tables import StateTable
from grainmotion.experiment.state_tracking import errors_of_state
from grainmotion.io.motions_csv import write_motions
from grainmotion.io.results import read_motions_h5, write_motions_h5
from grainmotion.model.motions import Motions
from grainmotion.model.progress import prefixed
from grainmotion.model.scan import Scan
from grainmotion.tracking.track import track_with_residual
from grainmotion.workflow.context import RunContext, load_result
from grainmotion.workflow.given_starts import given_start
from grainmotion.workflow.provenance import Stage
from grainmotion.workflow.reference_stages import SegmentedReference
from grainmotion.workflow.starts import StateStart, start_of
from grainmotion.workflow.state_checks import check_tracked_state, refused_motions


@dataclass(frozen=True, eq=False)
class TrackedState:
    """The motions of a state, and its residual radiographs if this process tracked it in this run."""

    motions: Motions
    residual: Image | None = None


def track_stage(
    context: RunContext, reference: Callable[[], SegmentedReference], name: str, tracked: Mapping[str, TrackedState]
) -> Stage[TrackedState]:
    """The stage that tracks one state, once it is checked; ``tracked`` holds the states before it."""
    names = [table.name for table in context.tables.states]
    index = names.index(name)
    table = context.tables.states[index]
    starts: tuple[Motions | None, ...] = (given_start(context, reference, index),)
    waits = start_of(context.tables.states, index)
    if waits is not None:
        starts = waits.starts({state: tracked[state].motions for state in waits.after})
    check_tracked_state(context, reference, table, starts[0])
    if name in context.refused:
        return _refused_stage(context, reference, table)
    source = context.states[index][1]
    return _stage(context, table, functools.partial(_track, context, reference, table, source, starts))


def _refused_stage(
    context: RunContext, reference: Callable[[], SegmentedReference], table: StateTable
) -> Stage[TrackedState]:
    """The stage of a state that is not tracked."""
    finding = context.refused[table.name]
    return _stage(context, table, lambda: TrackedState(refused_motions(reference().grains, finding)))


def _track(
    context: RunContext,
    reference: Callable[[], SegmentedReference],
    table: StateTable,
    source: ScanInput,
    starts: tuple[Motions | None, ...],
) -> TrackedState:
    """Track one state from the best of its starts, in this process or by all workers together."""
    grains, scan, settings = reference().released().grains, context.radiographs(source), context.tables.track
    progress, cluster = prefixed(context.progress, table.name), context.cluster
    if cluster is not None and cluster.together(grains):
        state = TeamState(table.name, scan, table.initial, starts, settings)
        motions, residual = cluster.track_together(grains, state, progress)
    else:
        backend = context.tracking_backend
        with errors_of_state(source.key, table.initial):
            motions, residual = track_with_residual(grains, scan, starts, settings, progress=progress, device=backend)
    return TrackedState(_explained(context, reference(), source, motions), residual)


def _explained(context: RunContext, reference: SegmentedReference, source: ScanInput, motions: Motions) -> Motions:
    """The motions with what reference and findings tell about them: common cause, residual, labels in doubt."""
    key, residuals = source.key, reference.residuals
    motions = with_common_cause(motions, common_cause(motions, key, context.findings_on(key)))
    if residuals:
        notes = residual_notes(reference.grains, motions, context.radiographs(source), residuals[-1])
        motions = replace(motions, fit=replace(motions.fit, notes=(*notes, *motions.fit.notes)))
    return in_doubt(motions, reference.doubts)


def track_side_by_side(context: RunContext, reference: Callable[[], SegmentedReference]) -> dict[str, TrackedState]:
    """Track states of a small sample at the same time, each on one worker, if several do not depend on another.

    Each is checked first, as in one process; states that are done or refused are left to `track_stage`.
    """
    cluster = context.cluster
    if cluster is None or len(context.states) < 2:
        return {}
    states = _to_be_tracked(context, reference)
    alone = [state for state in states if not state.after]
    if len(alone) < 2 or not cluster.one_worker_tracks_a_state(reference().grains):
        return {}
    tracked: dict[str, TrackedState] = {}
    tables = {table.name: table for table, _ in context.states}
    sources = {table.name: source for table, source in context.states}
    context.notify("tracking states side by side", 0, len(states))
    for name, motions in cluster.track(reference().grains, states, context.tables.track):
        explained = _explained(context, reference(), sources[name], motions)
        run = functools.partial(TrackedState, explained)
        tracked[name] = context.complete(_stage(context, tables[name], run))()
        context.notify(f"tracking states side by side: {name} done", len(tracked), len(states))
    return tracked


def _to_be_tracked(context: RunContext, reference: Callable[[], SegmentedReference]) -> list[State]:
    """The states that are neither done nor refused; one whose starts are not known yet is checked once they are."""
    states, known = list[State](), dict[str, Motions | None]()  # motions of the states that are done or refused
    for k, table in enumerate(context.tables.states):
        waits = start_of(context.tables.states, k)
        after = () if waits is None else tuple(name for name in waits.after if name not in known)
        starts = functools.partial(_starts, given_start(context, reference, k), waits, known)
        if after:
            later = functools.partial(_checked_scan, context, reference, k)
            states.append(State(table.name, later, table.initial, after, starts))
            continue
        check_tracked_state(context, reference, table, starts({})[0])
        if table.name in context.refused:
            known[table.name] = None
        elif context.cache.is_done(f"{table.name}/track", context.fingerprints.tracks[table.name]):
            known[table.name] = load_state(context, table).motions
        else:
            states.append(State(table.name, functools.partial(_scan, context, k), table.initial, starts=starts))
    return states


def _starts(
    given: Motions | None,
    waits: StateStart | None,
    known: Mapping[str, Motions | None],
    tracked: Mapping[str, Motions | None],
) -> tuple[Motions | None, ...]:
    """Motions to start from: given ones, or those of states that were known before or are tracked by now."""
    return (given,) if waits is None else waits.starts({**known, **tracked})


def _scan(context: RunContext, index: int, start: Motions | None) -> Scan:
    """The radiographs of a state that is checked, from whatever it starts."""
    return context.radiographs(context.states[index][1])


def _checked_scan(
    context: RunContext, reference: Callable[[], SegmentedReference], index: int, start: Motions | None
) -> Scan | None:
    """The radiographs of a state that starts from ``start``, once it is checked; None if it is refused."""
    table = context.tables.states[index]
    check_tracked_state(context, reference, table, start)
    return None if table.name in context.refused else _scan(context, index, start)


def _stage(context: RunContext, table: StateTable, run: Callable[[], TrackedState]) -> Stage[TrackedState]:
    files = [context.folder / table.name / name for name in ("motions.h5", "motions.csv")]

    def write(tracked: TrackedState) -> None:
        write_motions_h5(files[0], tracked.motions, asdict(context.tables.track))
        write_motions(files[1], tracked.motions)

    fingerprint = context.fingerprints.tracks[table.name]
    return Stage(f"{table.name}/track", fingerprint, files, run, write, functools.partial(load_state, context, table))


def load_state(context: RunContext, table: StateTable) -> TrackedState:
    """The motions of a state that is tracked, from their file."""
    return TrackedState(load_result(read_motions_h5, context.folder / table.name / "motions.h5"))
