"""Options that commands share, and the decorator that makes a command of a function.

Commands import what they run inside their bodies, so that ``--help`` loads no numerical library.
"""

from __future__ import annotations

import dataclasses
import inspect
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, get_type_hints

import typer

from grainmotion.backends.device import Device
from grainmotion.cli.findings import EXIT_CODES
from grainmotion.errors import GrainmotionError

File = Annotated[Path, typer.Argument(metavar="FILE", help="experiment file (TOML)")]
Out = Annotated[Path | None, typer.Option("--out", help="folder for results, instead of the file's own")]
Quiet = Annotated[bool, typer.Option("--quiet", "-q", help="show no progress; warnings are still shown")]
Force = Annotated[bool, typer.Option("--force", help="go on where a check of the input would stop the work")]
TryFixes = Annotated[bool, typer.Option("--try-fixes", help="apply what a check found to be clearly better")]
Strict = Annotated[bool, typer.Option("--strict", help="end with exit code 3 if there is any warning")]
Scheduler = Annotated[str | None, typer.Option("--scheduler", help="address of a Dask scheduler whose workers compute")]
Workers = Annotated[int | None, typer.Option("--workers", help="number of worker processes on this machine")]
OnDevice = Annotated[Device | None, typer.Option("--device", help="where rays are traced, instead of the file's own")]
Seed = Annotated[int, typer.Option("--seed", min=0, help="seed of packing, motions and noise")]
Photons = Annotated[float | None, typer.Option("--photons", help="photons a pixel detects without the sample")]
Views = Annotated[str | None, typer.Option("--views", help="numbers of views, as 2,3,4,6")]
StepDeg = Annotated[float | None, typer.Option("--step-deg", help="step between candidate angles, degrees")]
Shapes = Annotated[str | None, typer.Option("--shapes", help="some of stl,level-set,clump,harmonics; all by default")]
Codes = Annotated[str | None, typer.Option("--codes", help="whose level sets: some of yade,ls-dem,lammps")]
Spacing = Annotated[float | None, typer.Option("--spacing", help="spacing of the level set's grid, voxels")]
Spheres = Annotated[int | None, typer.Option("--spheres", help="largest number of spheres of a clump")]
FitOfClump = Annotated[str | None, typer.Option("--clump-fit", help="inside, or volume: spheres of the grain's volume")]
Degree = Annotated[int | None, typer.Option("--degree", help="largest degree of the spherical harmonics")]


@dataclasses.dataclass(frozen=True)
class Paths:
    """The experiment, and where its results go."""

    file: File
    out: Out = None


@dataclasses.dataclass(frozen=True)
class Execution:
    """Whether progress is shown, and which processes compute."""

    quiet: Quiet = False
    scheduler: Scheduler = None
    workers: Workers = None


@dataclasses.dataclass(frozen=True)
class Checks:
    """What follows from the findings of checks."""

    force: Force = False
    try_fixes: TryFixes = False
    strict: Strict = False


@dataclasses.dataclass(frozen=True)
class PlanOptions:
    """Settings of ``[plan]`` that the command line replaces."""

    photons: Photons = None
    views: Views = None
    step_deg: StepDeg = None


@dataclasses.dataclass(frozen=True)
class DemOptions:
    """Settings of ``[dem]`` that the command line replaces."""

    shapes: Shapes = None
    codes: Codes = None
    spacing: Spacing = None
    spheres: Spheres = None
    clump_fit: FitOfClump = None
    degree: Degree = None


OPTION_RECORDS: tuple[type, ...] = (Paths, Execution, Checks, PlanOptions, DemOptions)


def command(app: typer.Typer, function: Callable[..., None]) -> Callable[..., None]:
    """Add a command to an application, under the name of its function.

    A parameter that is one of `OPTION_RECORDS` stands for its fields.  Wrong input ends in one line on standard error
    and exit code 2, Ctrl-C in exit code 130.
    """
    hints = get_type_hints(function, include_extras=True)
    records = {name: hint for name, hint in hints.items() if hint in OPTION_RECORDS}
    parameters = []
    for parameter in inspect.signature(function).parameters.values():
        parts = [parameter]
        if parameter.name in records:
            parts = list(inspect.signature(records[parameter.name]).parameters.values())
        for part in parts:
            annotation = get_type_hints(records.get(parameter.name, function), include_extras=True)[part.name]
            parameters.append(part.replace(annotation=annotation, kind=inspect.Parameter.KEYWORD_ONLY))

    def invoke(**values: object) -> None:
        for name, record in records.items():
            values[name] = record(**{field.name: values.pop(field.name) for field in dataclasses.fields(record)})
        try:
            function(**values)
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

    invoke.__name__, invoke.__doc__ = function.__name__, function.__doc__
    invoke.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
    invoke.__annotations__ = {parameter.name: parameter.annotation for parameter in parameters}
    app.command(epilog=EXIT_CODES)(invoke)
    return function
