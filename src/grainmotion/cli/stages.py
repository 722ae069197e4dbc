"""What all commands that run stages share: read the experiment file, prepare a run, print how it ended."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, TypedDict

import grainmotion as gm
from grainmotion.cli import console
from grainmotion.cli.findings import exit_by, print_findings
from grainmotion.cli.options import Checks, Execution, OnDevice

if TYPE_CHECKING:
    from grainmotion._typing import Progress
    from grainmotion.cluster.connection import ComputeConfig
    from grainmotion.experiment.config import Experiment
    from grainmotion.workflow.run import RunResult


def read(file: Path, device: OnDevice = None) -> Experiment:
    """The experiment file, with the device that the command names."""
    experiment = gm.read_experiment(file)
    return experiment if device is None else experiment.on(device.value)


class RunOptions(TypedDict):
    """Keywords of `gm.run` that options of the command line set."""

    progress: Progress
    workplace: ComputeConfig


@contextmanager
def prepared(experiment: Experiment, execution: Execution, checks: Checks) -> Iterator[tuple[Experiment, RunOptions]]:
    """The experiment with the options about checks, and what `gm.run` needs to show progress and to find workers."""
    from grainmotion.cluster.connection import ComputeConfig

    workplace = ComputeConfig(execution.scheduler, execution.workers)
    with console.progress(execution.quiet) as progress:
        experiment = experiment.checked(force=checks.force, try_fixes=checks.try_fixes)
        yield experiment, {"progress": progress, "workplace": workplace}


def finish(result: RunResult, execution: Execution, checks: Checks, *last: str) -> None:
    """Print stages, states, all findings again, and the last lines; end with the exit code that follows."""
    console.print_stages(result, execution.quiet)
    console.print_states(result.motions)
    print_findings(result.findings, quiet=execution.quiet)
    for line in last:
        print(line)
    exit_by(result.motions, result.findings, strict=checks.strict)
