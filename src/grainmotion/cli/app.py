"""Command line: parse, call, print.

What the user gave wrong ends in one line on standard error and exit code 2; Ctrl-C in exit code 130.
"""

from __future__ import annotations

import dataclasses
import functools
import sys
import warnings
from collections.abc import Callable
from enum import StrEnum
from importlib.metadata import version
from pathlib import Path
from typing import Annotated, Any

import typer

from grainmotion.cli import console
from grainmotion.cli.demo import run_demo, write_case
from grainmotion.cluster.connection import LOCAL, ComputeConfig
from grainmotion.errors import GrainmotionError, InputError
from grainmotion.experiment.config import Experiment, read_experiment
from grainmotion.experiment.inputs import find_inputs
from grainmotion.experiment.inspection import inspect_inputs
from grainmotion.planning.plan import PlanSettings
from grainmotion.workflow.planning_run import plan_case, plan_experiment
from grainmotion.workflow.run import RunResult, Until
from grainmotion.workflow.run import run as run_pipeline

app = typer.Typer(
    name="grainmotion",
    help="The rigid motion of every grain of a sample, from one full scan and a few radiographs per state.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    add_completion=False,
)


class DeviceName(StrEnum):
    """Where rays are walked."""

    AUTO = "auto"
    CPU = "cpu"
    CUDA = "cuda"


File = Annotated[Path, typer.Argument(metavar="FILE", help="experiment file (TOML)")]
Out = Annotated[Path | None, typer.Option("--out", help="folder for results, instead of the file's [output]")]
Quiet = Annotated[bool, typer.Option("--quiet", "-q", help="show no progress")]

Scheduler = Annotated[
    str | None, typer.Option("--scheduler", help="address of a Dask scheduler whose workers do the work")
]
Workers = Annotated[int | None, typer.Option("--workers", help="processes of this machine that do the work")]
Where = Annotated[DeviceName | None, typer.Option("--device", help="where rays are walked, instead of the file's own")]
Seed = Annotated[int, typer.Option("--seed", min=0, help="of packing, motions and noise")]


class Format(StrEnum):
    """What `export` writes."""

    VTK = "vtk"
    SPAM = "spam"


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


def _reported(command: Callable[..., None]) -> Callable[..., None]:
    """End in one line instead of a traceback where the user, not the program, is at fault."""

    @functools.wraps(command)
    def guarded(*args: Any, **kwargs: Any) -> None:
        try:
            command(*args, **kwargs)
        except GrainmotionError as error:
            print(f"error: {' '.join(str(error).split())}", file=sys.stderr)
            raise typer.Exit(2) from None
        except KeyboardInterrupt:
            print("interrupted: finished stages are kept; the same command continues", file=sys.stderr)
            raise typer.Exit(130) from None
        except MemoryError as error:
            fact = str(error) or "not enough of it"
            print(f"error: memory: {fact}; give larger voxels or fewer of them", file=sys.stderr)
            raise typer.Exit(1) from None

    return guarded


# ---------------------------------------------------------------------- the main job and its stages
@app.command()
@_reported
def run(
    file: File,
    out: Out = None,
    device: Where = None,
    quiet: Quiet = False,
    scheduler: Scheduler = None,
    workers: Workers = None,
) -> None:
    """Do the whole job; what is done already and unchanged is not done again."""
    result = _run(_read(file, device), "report", out, quiet, ComputeConfig(scheduler, workers))
    console.print_states(result.motions)
    print(f"report: {result.report}")


@app.command()
@_reported
def reconstruct(
    file: File,
    out: Out = None,
    device: Where = None,
    quiet: Quiet = False,
    scheduler: Scheduler = None,
    workers: Workers = None,
) -> None:
    """Reconstruct the reference volume and stop."""
    result = _run(_read(file, device), "reconstruct", out, quiet, ComputeConfig(scheduler, workers))
    print(f"volume: in {result.folder}")


@app.command()
@_reported
def segment(
    file: File, out: Out = None, quiet: Quiet = False, scheduler: Scheduler = None, workers: Workers = None
) -> None:
    """Find the grains of the reference volume and stop."""
    result = _run(read_experiment(file), "segment", out, quiet, ComputeConfig(scheduler, workers))
    print(f"grains: {result.folder / 'reference.h5'}")


@app.command()
@_reported
def track(
    file: File,
    out: Out = None,
    device: Where = None,
    quiet: Quiet = False,
    scheduler: Scheduler = None,
    workers: Workers = None,
) -> None:
    """Track the grains through all states and stop before residuals, exports and report."""
    result = _run(_read(file, device), "track", out, quiet, ComputeConfig(scheduler, workers))
    console.print_states(result.motions)


@app.command()
@_reported
def report(
    file: File, out: Out = None, quiet: Quiet = False, scheduler: Scheduler = None, workers: Workers = None
) -> None:
    """Write the report, after whatever it needs that is not done yet."""
    result = _run(read_experiment(file), "report", out, quiet, ComputeConfig(scheduler, workers))
    print(f"report: {result.report}")


@app.command()
@_reported
def export(
    file: File,
    format: Annotated[list[Format], typer.Option("--format", help="vtk for ParaView, spam for spam")],
    out: Out = None,
    quiet: Quiet = False,
) -> None:
    """Write the motions for other software, after whatever it needs that is not done yet."""
    experiment = read_experiment(file)
    wanted = sorted({*experiment.tables.output.exports, *(f.value for f in format)})
    output = experiment.tables.output.model_copy(update={"exports": wanted})
    tables = experiment.tables.model_copy(update={"output": output})
    result = _run(dataclasses.replace(experiment, tables=tables), "report", out, quiet)
    for name in result.motions:
        print(f"exported: {result.folder / name}")


@app.command()
@_reported
def inspect(file: File) -> None:
    """Describe the data and what they need, without doing any work."""
    console.print_inspection(inspect_inputs(find_inputs(read_experiment(file))))


def _read(file: Path, device: DeviceName | None) -> Experiment:
    """The experiment file, with the device that the command names."""
    experiment = read_experiment(file)
    return experiment if device is None else experiment.on(device.value)


def _run(
    experiment: Experiment, until: Until, out: Path | None, quiet: bool, workplace: ComputeConfig = LOCAL
) -> RunResult:
    with console.progress(quiet) as listener:
        result = run_pipeline(experiment, out=out, until=until, progress=listener, workplace=workplace)
    if not quiet:
        print(
            f"done: {', '.join(result.done) or 'nothing'}; kept: {', '.join(result.reused) or 'nothing'}",
        )
    return result


# ---------------------------------------------------------------------- before beam time
@app.command()
@_reported
def plan(
    file: Annotated[
        Path | None, typer.Argument(metavar="[FILE]", help="experiment file (TOML) with the reference")
    ] = None,
    case: Annotated[CaseName | None, typer.Option("--case", help="a simulated packing instead of a file")] = None,
    photons: Annotated[
        float | None, typer.Option("--photons", help="a pixel of open beam; else the file's or case's own")
    ] = None,
    views: Annotated[str | None, typer.Option("--views", help="numbers of views, as 2,3,4,6")] = None,
    step_deg: Annotated[float | None, typer.Option("--step-deg", help="between candidate angles, degrees")] = None,
    out: Annotated[Path | None, typer.Option("--out", help="folder in which plan/ is made")] = None,
    seed: Seed = 0,
    quiet: Quiet = False,
) -> None:
    """Predict precision and capture for 2, 3, 4, 6 views of a sample, and find the best angles."""
    if (file is None) == (case is None):
        fact = "neither an experiment file nor --case is given" if case is None else "a file and --case are both given"
        raise InputError("plan", fact, "give one of them")
    given: dict[str, Any] = {"photons": photons, "views": _counts(views), "step_deg": step_deg}
    given = {key: value for key, value in given.items() if value is not None}
    experiment = read_experiment(file) if file is not None else None
    try:
        settings = dataclasses.replace(experiment.tables.plan if experiment else PlanSettings(), **given)
    except InputError as error:
        option = f"--{error.where.rpartition('.')[2].replace('_', '-')}"
        raise InputError(option, error.fact, error.remedy) from error
    with console.progress(quiet) as listener:
        if experiment is not None:
            found, folder = plan_experiment(experiment, settings, out=out, progress=listener)
        else:
            assert case is not None
            found, folder = plan_case(
                case.value, settings, out=out or Path(), photons=photons, seed=seed, progress=listener
            )
    console.print_plan(found)
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
@app.command()
@_reported
def simulate(
    folder: Annotated[Path, typer.Argument(metavar="OUTDIR", help="folder for the experiment")],
    case: Annotated[
        DatasetName, typer.Option("--case", help="6 grains in seconds, the paper's scale, or a hard case of 6 grains")
    ] = DatasetName.SMALL,
    seed: Seed = 0,
    quiet: Quiet = False,
) -> None:
    """Simulate an experiment with its truth: radiographs, flats, darks, geometry and experiment.toml."""
    with console.progress(quiet) as listener:
        path = write_case(folder, case.value, seed, progress=listener)
    print(f"experiment: {path}")


@app.command()
@_reported
def demo(
    folder: Annotated[Path, typer.Argument(metavar="[OUTDIR]", help="folder for it all")] = Path("grainmotion-demo"),
    seed: Seed = 0,
    device: Where = None,
    quiet: Quiet = False,
) -> None:
    """Simulate a small packing, do the whole job, and compare it with the truth."""
    with console.progress(quiet) as listener:
        found = run_demo(folder, seed, listener, device.value if device else "auto")
    console.print_comparisons(found.comparisons)
    print(f"report: {found.result.report}")


@app.command("version")
def show_version() -> None:
    """Print the version."""
    print(version("grainmotion"))


def main() -> None:
    """Entry point of the command ``grainmotion``."""
    warnings.simplefilter("ignore", FutureWarning)  # what a library will change is not the user's matter
    app()
