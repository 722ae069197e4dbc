"""Command line: parse, call, print."""

from __future__ import annotations

import dataclasses
import warnings
from enum import StrEnum
from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import Annotated

import typer

import grainmotion as gm
from grainmotion.cli import console
from grainmotion.cli.export_commands import export_app
from grainmotion.cli.findings import EXIT_CODES, exit_by, print_findings
from grainmotion.cli.inspect_commands import init, inspect
from grainmotion.cli.options import (
    Checks,
    Execution,
    OnDevice,
    Paths,
    PlanOptions,
    Quiet,
    Seed,
    command,
)
from grainmotion.cli.stages import finish, prepared, read
from grainmotion.cli.view_command import view
from grainmotion.cli.watch_command import watch
from grainmotion.errors import InputError

app = typer.Typer(
    name="grainmotion",
    help="The rigid motion of every grain of a sample, from one full scan and a few radiographs per state.",
    epilog=EXIT_CODES,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    add_completion=False,
)
add_command = partial(command, app)


class CaseName(StrEnum):
    """A simulated packing."""

    SMALL = "small"
    PAPER = "paper"


class DatasetName(StrEnum):
    """What `simulate` writes: the packings, and the hard cases at the small one's size."""

    SMALL = "small"
    PAPER = "paper"
    NOISY = "noisy"
    BEAM_HARDENING = "beam-hardening"
    BLUR = "blur"
    MISALIGNED = "misaligned"
    MISALIGNED_STATE = "misaligned-state"
    GAIN_DRIFT = "gain-drift"
    GAIN_DRIFT_VIEWS = "gain-drift-views"
    CONTAINER = "container"
    MISSING = "missing"
    BROKEN = "broken"
    NEAR_SPHERICAL = "near-spherical"
    SHEAR_BAND = "shear-band"
    PLAIN = "plain"
    TALL = "tall"
    WIDE = "wide"
    PLATENS = "platens"
    WET = "wet"
    DRAINS = "drains"
    SIZES = "sizes"
    GONE = "gone"
    SOFT = "soft"
    SETTLING = "settling"
    MATERIALS = "materials"
    COMBINED = "combined"
    ROUND = "round"


# ---------------------------------------------------------------------- the main job and its stages
@add_command
def run(paths: Paths, *, device: OnDevice = None, execution: Execution, checks: Checks) -> None:
    """Run all stages; those that are done already and unchanged are not repeated.

    Example: grainmotion run experiment.toml
    """
    with prepared(read(paths.file, device), execution, checks) as (experiment, options):
        result = gm.run(experiment, out=paths.out, **options)
    finish(result, execution, checks, f"report: {result.report}")


@add_command
def reconstruct(paths: Paths, *, device: OnDevice = None, execution: Execution, checks: Checks) -> None:
    """Reconstruct the reference volume and stop.

    Example: grainmotion reconstruct experiment.toml --device cpu
    """
    with prepared(read(paths.file, device), execution, checks) as (experiment, options):
        result = gm.run(experiment, out=paths.out, until="reconstruct", **options)
    finish(result, execution, checks, f"volume: in {result.folder}")


@add_command
def segment(paths: Paths, execution: Execution, checks: Checks) -> None:
    """Find the grains of the reference volume and stop.

    Example: grainmotion segment experiment.toml
    """
    with prepared(read(paths.file), execution, checks) as (experiment, options):
        result = gm.run(experiment, out=paths.out, until="segment", **options)
    finish(result, execution, checks, f"grains: {result.folder / 'reference.h5'}")


@add_command
def track(paths: Paths, *, device: OnDevice = None, execution: Execution, checks: Checks) -> None:
    """Track the grains through all states and stop before residuals, exports and report.

    Example: grainmotion track experiment.toml --workers 4
    """
    with prepared(read(paths.file, device), execution, checks) as (experiment, options):
        result = gm.run(experiment, out=paths.out, until="track", **options)
    finish(result, execution, checks)


@add_command
def report(paths: Paths, execution: Execution, checks: Checks) -> None:
    """Write the report; stages that it needs and that are not done yet are done first.

    Example: grainmotion report experiment.toml
    """
    with prepared(read(paths.file), execution, checks) as (experiment, options):
        result = gm.run(experiment, out=paths.out, until="report", **options)
    finish(result, execution, checks, f"report: {result.report}")


app.add_typer(export_app, name="export")


add_command(watch)
add_command(view)
add_command(inspect)
add_command(init)


# ---------------------------------------------------------------------- before beam time
@add_command
def plan(
    file: Annotated[
        Path | None, typer.Argument(metavar="FILE", help="experiment file (TOML) with the reference")
    ] = None,
    *,
    case: Annotated[CaseName | None, typer.Option("--case", help="a simulated packing instead of a file")] = None,
    options: PlanOptions,
    out: Annotated[Path | None, typer.Option("--out", help="folder in which plan/ is made")] = None,
    seed: Seed = 0,
    quiet: Quiet = False,
) -> None:
    """Predict precision and capture range for 2, 3, 4, 6 views of a sample, and find the best angles.

    Example: grainmotion plan experiment.toml --photons 20000

    Example: grainmotion plan --case paper --views 2,4
    """
    from grainmotion.workflow.planning_run import plan_case, plan_experiment

    if (file is None) == (case is None):
        fact = "neither an experiment file nor --case is given" if case is None else "a file and --case are both given"
        raise InputError("plan", fact, "give one of them")
    changes = {**dataclasses.asdict(options), "views": _counts(options.views)}
    changes = {key: value for key, value in changes.items() if value is not None}
    experiment = None if file is None else read(file)
    try:
        settings = dataclasses.replace(experiment.tables.plan if experiment else gm.PlanSettings(), **changes)
    except InputError as error:
        option = f"--{error.where.rpartition('.')[2].replace('_', '-')}"
        raise InputError(option, error.fact, error.remedy) from error
    with console.progress(quiet) as progress:
        if experiment is not None:
            result, folder = plan_experiment(experiment, settings, out=out, progress=progress)
        else:
            assert case is not None
            result, folder = plan_case(
                case.value, settings, out=out or Path(), photons=options.photons, seed=seed, progress=progress
            )
    console.print_plan(result)
    print(f"plan: {folder}")


def _counts(text: str | None) -> tuple[int, ...] | None:
    """The numbers of ``2,3,4``."""
    if text is None:
        return None
    try:
        return tuple(int(part) for part in text.split(","))
    except ValueError:
        raise InputError("--views", f"'{text}' is no list of whole numbers", "give them as 2,3,4,6") from None


# ---------------------------------------------------------------------- simulated experiments
@add_command
def simulate(
    folder: Annotated[Path, typer.Argument(metavar="OUTDIR", help="folder for the experiment")],
    case: Annotated[
        DatasetName,
        typer.Option("--case", help="6 grains in seconds, the paper's scale, or a hard case of 6 to 24 grains"),
    ] = DatasetName.SMALL,
    seed: Seed = 0,
    quiet: Quiet = False,
) -> None:
    """Simulate an experiment with its true motions: radiographs, flats, darks, geometry and experiment.toml.

    Example: grainmotion simulate noisy-sample --case noisy
    """
    from grainmotion.cli.demo import write_case

    with console.progress(quiet) as progress:
        path = write_case(folder, case.value, seed, progress=progress)
    print(f"experiment: {path}")


@add_command
def demo(
    folder: Annotated[Path, typer.Argument(metavar="OUTDIR", help="folder for data and results")] = Path(
        "grainmotion-demo"
    ),
    seed: Seed = 0,
    device: OnDevice = None,
    quiet: Quiet = False,
) -> None:
    """Simulate a small packing, measure its motions, and compare them with the true ones.

    Example: grainmotion demo my-demo
    """
    from grainmotion.cli.demo import run_demo

    with console.progress(quiet) as progress:
        outcome = run_demo(folder, seed, device=device.value if device else "auto", progress=progress)
    console.print_comparisons(outcome.comparisons)
    print_findings(outcome.result.findings, quiet=quiet)
    print(f"report: {outcome.result.report}")
    exit_by(outcome.result.motions, (), strict=False)


@app.command("version")
def show_version() -> None:
    """Print the version.

    Example: grainmotion version
    """
    print(version("grainmotion"))


def main() -> None:
    """Entry point of the command ``grainmotion``."""
    warnings.simplefilter("ignore", FutureWarning)  # of libraries: users can do nothing about them
    app()
