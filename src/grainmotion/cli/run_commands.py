"""The main job and its stages: `run`, `reconstruct`, `segment`, `track`, `report`."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

from grainmotion.cli.options import Checks, Display, DryRun, Execution, OnDevice, Paths
from grainmotion.cli.stages import StagesCall, StagesToRun, read, run_stages

if TYPE_CHECKING:
    from grainmotion.workflow.run import RunResult


def run(
    paths: Paths, *, dry_run: DryRun = False, device: OnDevice = None, execution: Execution, checks: Checks,
    display: Display,
) -> StagesToRun:  # fmt: skip
    """Measure the motions of all states: run all stages, but those that are done already and unchanged.

    Example: grainmotion run experiment.toml

    Example: grainmotion run experiment.toml --dry-run
    """
    call = StagesCall(paths.out, execution, checks, dry_run, display)
    return partial(run_stages, read(paths.file, device), call)


def reconstruct(
    paths: Paths, *, dry_run: DryRun = False, device: OnDevice = None, execution: Execution, checks: Checks,
    display: Display,
) -> StagesToRun:  # fmt: skip
    """Reconstruct the reference volume and stop.

    Example: grainmotion reconstruct experiment.toml --device cpu
    """
    call = StagesCall(paths.out, execution, checks, dry_run, display)
    return partial(
        run_stages, read(paths.file, device), call, until="reconstruct", lines=lambda r: [f"volume: in {r.folder}"]
    )


def segment(
    paths: Paths, *, dry_run: DryRun = False, execution: Execution, checks: Checks, display: Display
) -> StagesToRun:
    """Find the grains of the reference volume and stop.

    Example: grainmotion segment experiment.toml
    """

    def lines(result: RunResult) -> list[str]:
        return [f"grains: {result.folder / 'reference.h5'}"]

    call = StagesCall(paths.out, execution, checks, dry_run, display)
    return partial(run_stages, read(paths.file), call, until="segment", lines=lines)


def track(
    paths: Paths, *, dry_run: DryRun = False, device: OnDevice = None, execution: Execution, checks: Checks,
    display: Display,
) -> StagesToRun:  # fmt: skip
    """Track the grains through all states and stop before residuals, exports and report.

    Example: grainmotion track experiment.toml --workers 4
    """
    call = StagesCall(paths.out, execution, checks, dry_run, display)
    return partial(run_stages, read(paths.file, device), call, until="track")


def report(
    paths: Paths, *, dry_run: DryRun = False, execution: Execution, checks: Checks, display: Display
) -> StagesToRun:
    """Write the report; stages that it needs and that are not done yet are done first.

    Example: grainmotion report experiment.toml
    """
    call = StagesCall(paths.out, execution, checks, dry_run, display)
    return partial(run_stages, read(paths.file), call)
