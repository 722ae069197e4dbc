"""``--dry-run``: which stages a run would do and keep, why, and what it would need; nothing is written."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from grainmotion.cli.documents import DryRunOutcome, StagePlan, WorkerPlan
from grainmotion.cli.outcome import Outcome
from grainmotion.cli.terminal import Terminal
from grainmotion.cli.time_left import duration

if TYPE_CHECKING:
    from grainmotion.cluster.connection import ComputeConfig
    from grainmotion.experiment.config import Experiment
    from grainmotion.workflow.estimates import StageEstimate
    from grainmotion.workflow.run import Until

ROUGH = (
    "times of stages that no log of an earlier run tells hold within a factor of about 3; after an installation a "
    "minute and 0.2 GB of memory are added once, for compiling"
)
UNCHECKED = "checks of the radiographs may stop a run, leave a state out, or repeat a stage that is kept here"
MAX_STAGES_SHOWN = 60
"""Stages that the terminal shows; JSON has all."""


def dry_run(experiment: Experiment, out: Path | None, until: Until, workplace: ComputeConfig) -> Outcome:
    """What the run would be."""
    from grainmotion.cluster.worker_limits import limits_of_workers
    from grainmotion.workflow.dry_run import planned_run
    from grainmotion.workflow.estimates import estimate

    planned = planned_run(experiment, out=out, until=until)
    workers = limits_of_workers(workplace)
    needs = estimate(planned, workplace, workers)
    document = DryRunOutcome(
        folder=str(planned.folder.absolute()),
        stages=[
            StagePlan(stage.name, stage.kept, stage.why, time.seconds, time.from_log)
            for stage, time in zip(planned.planned, needs.stages, strict=True)
        ],
        seconds=needs.seconds,
        start=needs.start,
        memory=int(needs.memory),
        memory_of_worker=int(needs.memory_of_worker),
        workers=[
            WorkerPlan(each.address, each.threads, int(each.memory), not 0 < each.memory < needs.memory_of_worker)
            for each in workers
        ],
        memory_usable=int(needs.memory_usable),
        memory_in_files=int(needs.memory_in_files),
        disk=int(needs.disk),
        disk_free=int(needs.disk_free),
        notes=[*([ROUGH] if any(not _known(time) for time in needs.stages) else []), UNCHECKED],
    )
    return Outcome(document, partial(_show, document))


def _known(time: StageEstimate) -> bool:
    """Whether the time of a stage is known from the log, or is none."""
    return time.from_log or time.seconds == 0


def _show(document: DryRunOutcome, terminal: Terminal) -> None:
    """Print a table of the stages, and what they need."""
    from rich.markup import escape
    from rich.table import Table

    table = Table("stage", "", "why", "CPU time")
    for stage in document.stages[:MAX_STAGES_SHOWN]:
        what = "[green]keep[/]" if stage.kept else "[yellow]do[/]"
        table.add_row(escape(stage.name), what, escape(stage.why), "" if stage.kept else _time(stage))
    terminal.console().print(table)
    if len(document.stages) > MAX_STAGES_SHOWN:
        print(f"... and {len(document.stages) - MAX_STAGES_SHOWN} more stages; --json lists all")
    done = sum(not stage.kept for stage in document.stages)
    print(f"dry run: {done} of {len(document.stages)} stages would be done; nothing was written")
    print(f"results: {document.folder}")
    if done:
        start = "to load libraries, read radiographs and check them"
        print(f"time: about {duration(document.seconds)} of CPU time, {duration(document.start)} of it {start}")
        usable = "" if document.memory_usable == 0 else f", of {document.memory_usable / 1e9:.2f} GB that may be used"
        worker = document.memory_of_worker
        each = f", and {_gigabytes(worker)} GB of each worker" if worker else ""
        print(f"memory: about {document.memory / 1e9:.2f} GB at the peak{usable}{each}")
        if worker:
            _show_workers(document)
        if document.memory_in_files:
            size = _size(document.memory_in_files)
            print(f"files: that is too little; {size} of large arrays would be kept in files, which takes longer")
        print(f"disk: about {_size(document.disk)}, of {_size(document.disk_free)} that are free")
        for note in () if terminal.quiet else document.notes:
            print(f"note: {note}")


def _show_workers(document: DryRunOutcome) -> None:
    """Print what the workers may use, and a warning if that is too little."""
    workers, need = document.workers, document.memory_of_worker
    if not workers:
        print("warning: the scheduler has no workers yet, and this is what one alone needs; start some (`dask worker`)")
        return
    threads = _range([worker.threads for worker in workers], str)
    limits = [worker.memory_limit for worker in workers if worker.memory_limit]
    memory = f"{_range(limits, _gigabytes)} GB" if limits else "no limit"
    print(f"workers: {len(workers)}; threads of each: {threads}; memory that each may use: {memory}")
    short = sorted((worker.memory_limit, worker.address) for worker in workers if not worker.enough)
    if short:
        least, address = short[0]
        at = f" ({address})" if address else ""
        few = f"{len(short)} of {len(workers)} workers {'have' if len(short) > 1 else 'has'} too little memory"
        remedy = "raise `dask worker --memory-limit`, or start more workers" if address else "start fewer workers"
        print(f"warning: {few}: {_gigabytes(least)} GB{at}, where each needs {_gigabytes(need)} GB; {remedy}")


def _range(values: list[int], text: Callable[[int], str]) -> str:
    """The one value that all have, or the smallest and the largest."""
    least, most = text(min(values)), text(max(values))
    return least if least == most else f"{least} to {most}"


def _gigabytes(size: float) -> str:
    return f"{size / 1e9:.2f}"


def _size(bytes_: float) -> str:
    """Bytes as a person says them."""
    return f"{bytes_ / 1e9:.1f} GB" if bytes_ > 0.5e9 else f"{max(1, round(bytes_ / 1e6))} MB"


def _time(stage: StagePlan) -> str:
    """The time of a stage as a table shows it."""
    if stage.seconds is None:
        return "?"
    time = "under 1 s" if stage.seconds < 1 else duration(stage.seconds)
    return f"{time} last time" if stage.from_log else f"about {duration(stage.seconds)}"
