"""What all commands that run stages share: read the experiment file, run or tell what a run would do, hand it back."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, TypedDict

import grainmotion as gm
from grainmotion.cli.command import current_call
from grainmotion.cli.options import Checks, Display, Execution, OnDevice
from grainmotion.cli.outcome import Outcome, ending_by
from grainmotion.cli.progress import progress

if TYPE_CHECKING:
    from collections.abc import Iterator

    from grainmotion._typing import Progress
    from grainmotion.cluster.connection import ComputeConfig
    from grainmotion.experiment.config import Experiment
    from grainmotion.workflow.run import RunResult, Until

Lines = Callable[["RunResult"], list[str]]
StagesToRun = Callable[[], Outcome]
"""What a command hands back once its options are read: the call of `run_stages` that is to be made."""


def read(file: Path, device: OnDevice = None) -> Experiment:
    """The experiment file, with the device that the command names."""
    from grainmotion.cli.no_experiment import check_experiment_file

    check_experiment_file(file)
    experiment = gm.read_experiment(file)
    return experiment if device is None else experiment.on(device.value)


class RunOptions(TypedDict):
    """Keywords of `gm.run` that options of the command line set."""

    progress: Progress
    workplace: ComputeConfig


@contextmanager
def prepared(
    experiment: Experiment, execution: Execution, checks: Checks, display: Display
) -> Iterator[tuple[Experiment, RunOptions]]:
    """The experiment with the options about checks, and what `gm.run` needs to show progress and to find workers."""
    workplace, call = execution.workplace, current_call()
    states = [state.name for state in experiment.tables.states]
    with progress(display.terminal, call.stop, states, call.found) as listener:
        experiment = experiment.checked(force=checks.force, try_fixes=checks.try_fixes)
        yield experiment, {"progress": listener, "workplace": workplace}


@dataclass(frozen=True)
class StagesCall:
    """What a command hands on to `run_stages`."""

    out: Path | None
    execution: Execution
    checks: Checks
    dry_run: bool
    display: Display


def run_stages(
    experiment: Experiment, call: StagesCall, *, until: Until = "report", lines: Lines = lambda result: []
) -> Outcome:
    """Run the stages up to ``until``, or tell what that would be; ``lines`` are told beside the usual end of a run."""
    from grainmotion.cli.json_output import run_outcome
    from grainmotion.cli.summary import print_run

    checks, out = call.checks, call.out
    if call.dry_run:
        from grainmotion.cli.dry_run import dry_run

        wanted = experiment.checked(force=checks.force, try_fixes=checks.try_fixes)
        with progress(call.display.terminal, current_call().stop):
            return dry_run(wanted, out, until, call.execution.workplace)
    with prepared(experiment, call.execution, checks, call.display) as (wanted, options):
        result = gm.run(wanted, out=out, until=until, **options)
    ending = ending_by(result.motions, result.findings, strict=checks.strict)
    show = partial(print_run, result=result, lines=lines(result))
    return Outcome(run_outcome(result), show, result.findings, ending)
