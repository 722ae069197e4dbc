"""States of a run: which motions each starts from, and who tracks it."""

from __future__ import annotations

from pathlib import Path

from grainmotion.cluster.state_tasks import State
from grainmotion.experiment.config import StateTable
from grainmotion.experiment.scan_inputs import ScanInput
from grainmotion.experiment.state_tracking import track_state
from grainmotion.io.motions_csv import write_motions
from grainmotion.io.results import read_motions_h5, write_motions_h5
from grainmotion.model.motions import Motions
from grainmotion.workflow.context import RunContext, kept


def track_states(job: RunContext) -> dict[str, Motions]:
    """The motions of all states, in their order; what is there already is read."""
    motions = _side_by_side(job)
    previous = None
    for scan, table in _states(job):
        if table.name not in motions:
            motions[table.name] = _track(job, scan, table, previous)
        previous = motions[table.name]
    return {table.name: motions[table.name] for _, table in _states(job)}


def _states(job: RunContext) -> list[tuple[ScanInput, StateTable]]:
    return list(zip(job.corrected.states, job.tables.states, strict=True))


def _track(job: RunContext, scan: ScanInput, table: StateTable, previous: Motions | None) -> Motions:
    """One state, by all who work."""
    stage, fingerprint = f"{table.name}/track", job.track_prints[table.name]
    if job.has(stage, fingerprint):
        return kept(read_motions_h5, _files(job, table)[0])
    start = previous if table.initial == "previous" else _named(job, table)
    listener = job.listener(table.name)
    motions = track_state(scan, table.initial, job.grains(), start, job.tables.track, listener, job.walkers)
    _keep(job, table, motions)
    return motions


def _side_by_side(job: RunContext) -> dict[str, Motions]:
    """Of a small sample the states that are to be tracked, each by one worker, if several need not wait."""
    states: list[State] = []
    before: Motions | str | None = None
    missing = [t for _, t in _states(job) if not job.ledger.is_done(f"{t.name}/track", job.track_prints[t.name])]
    if job.cluster is None or len(missing) < 2 or not job.cluster.walks_states(job.grains()):
        return {}
    for scan, table in _states(job):
        if table not in missing:
            before = kept(read_motions_h5, _files(job, table)[0])
            continue
        start = before if table.initial == "previous" else _named(job, table)
        states.append(State(table.name, scan, table.initial, start))
        before = table.name
    if sum(not isinstance(state.start, str) for state in states) < 2:
        return {}
    found: dict[str, Motions] = {}
    job.tell("tracking states side by side", 0, len(states))
    for name, motions in job.cluster.track(job.grains(), states, job.tables.track):
        found[name] = motions
        _keep(job, next(table for table in missing if table.name == name), motions)
        job.tell(f"tracking states side by side: {name} done", len(found), len(states))
    return found


def _named(job: RunContext, table: StateTable) -> Motions | None:
    """The motions of the file that a state is told to start from, or no motion."""
    return job.inputs.starts[job.tables.states.index(table)]


def _keep(job: RunContext, table: StateTable, motions: Motions) -> None:
    """Write a state's motions."""
    stage, files = f"{table.name}/track", _files(job, table)
    job.ledger.strike(stage)
    write_motions_h5(files[0], motions)
    write_motions(files[1], motions)
    job.finish(stage, job.track_prints[table.name], files)


def _files(job: RunContext, table: StateTable) -> list[Path]:
    return [job.folder / table.name / name for name in ("motions.h5", "motions.csv")]
