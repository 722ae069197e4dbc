"""`grainmotion export`: files for other software.

`grainmotion export FILE --format vtk` is older than the subcommands and stays: arguments that begin with no subcommand
are those of `files`.
"""

from __future__ import annotations

import dataclasses
from enum import StrEnum
from functools import partial
from typing import TYPE_CHECKING, Annotated

import typer
from typer.core import TyperGroup

import grainmotion as gm
from grainmotion.cli.findings import EXIT_CODES
from grainmotion.cli.options import Checks, DemOptions, Execution, Paths, command
from grainmotion.cli.stages import finish, prepared, read
from grainmotion.errors import InputError

if TYPE_CHECKING:
    from grainmotion.experiment.config import Experiment, Export
    from grainmotion.grain_shapes.settings import DemSettings

DEFAULT_EXPORT = "files"


class ExportGroup(TyperGroup):
    """Subcommands of `export`; arguments that begin with none of them are those of `files`."""

    def parse_args(self, ctx: typer.Context, args: list[str]) -> list[str]:  # type: ignore[override]  # base is private
        """Arguments of the group, with `files` put in front where no subcommand is named."""
        if args and args[0] not in self.commands and args[0] not in ctx.help_option_names:
            args = [DEFAULT_EXPORT, *args]
        return super().parse_args(ctx, args)


export_app = typer.Typer(
    name="export",
    cls=ExportGroup,
    help="Write results for other software.\n\nExample: grainmotion export experiment.toml --format vtk",
    epilog=EXIT_CODES,
    no_args_is_help=True,
)
add_command = partial(command, export_app)


class Format(StrEnum):
    """What `export FILE` writes."""

    VTK = "vtk"
    SPAM = "spam"
    TIFF = "tiff"
    OME_ZARR = "ome-zarr"
    DEM = "dem"
    MECHANICS = "mechanics"


class SpamPoint(StrEnum):
    """The point whose displacement a file for spam gives."""

    CENTROID = "centroid"
    BOX = "box"


@add_command
def files(
    paths: Paths,
    *,
    format: Annotated[
        list[Format],
        typer.Option(
            "--format",
            help="vtk for ParaView, tiff for Fiji, ome-zarr for napari, spam, dem, mechanics; repeat it for several",
        ),
    ],
    about: Annotated[
        SpamPoint | None,
        typer.Option(
            "--about", help="spam: displacement of the label's centroid, or of the middle of its bounding box"
        ),
    ] = None,
    execution: Execution,
    checks: Checks,
) -> None:
    """Write files for other software; the word `files` may be left out. Stages that are missing are done first.

    Example: grainmotion export experiment.toml --format vtk --format tiff
    """
    changes = {} if about is None else {"spam_about": about.value}
    wanted = _with_exports(read(paths.file), [f.value for f in format], **changes)
    with prepared(wanted, execution, checks) as (experiment, options):
        result = gm.run(experiment, out=paths.out, **options)
    names = [*result.motions, *(["dem"] if Format.DEM in format else [])]
    finish(result, execution, checks, *(f"exported: {result.folder / name}" for name in names))


@add_command
def mechanics(paths: Paths, *, execution: Execution, checks: Checks) -> None:
    """Write strains, contacts, fabric and void ratios of the reference and of each state.

    The table mechanics of the experiment file has the settings.

    Example: grainmotion export mechanics experiment.toml
    """
    wanted = _with_exports(read(paths.file), ["mechanics"])
    with prepared(wanted, execution, checks) as (experiment, options):
        result = gm.run(experiment, out=paths.out, **options)
    files = [f"mechanics: {result.folder / name / 'mechanics.json'}" for name in result.motions]
    finish(result, execution, checks, *files)


@add_command
def dem(paths: Paths, *, options: DemOptions, execution: Execution, checks: Checks) -> None:
    """Write each grain as a rigid body for DEM codes: STL, level set, clump, harmonics, inertia, poses, velocities.

    The table dem of the experiment file has the settings; options replace them.

    Example: grainmotion export dem experiment.toml --shapes stl,clump --spheres 40
    """
    experiment = _with_exports(read(paths.file), ["dem"])
    settings = _dem_settings(experiment.tables.dem, options)
    tables = experiment.tables.model_copy(update={"dem": settings})
    with prepared(dataclasses.replace(experiment, tables=tables), execution, checks) as (experiment, run_options):
        result = gm.run(experiment, out=paths.out, **run_options)
    finish(result, execution, checks, f"exported: {result.folder / 'dem'}")


def _with_exports(experiment: Experiment, names: list[Export], **changes: str) -> Experiment:
    """The experiment, with more exports, and other settings of ``[output]``."""
    output = experiment.tables.output
    output = output.model_copy(update={"exports": sorted({*output.exports, *names}), **changes})
    return dataclasses.replace(experiment, tables=experiment.tables.model_copy(update={"output": output}))


def _dem_settings(settings: DemSettings, options: DemOptions) -> DemSettings:
    """The settings with what the command line replaces."""
    changes = {key: value for key, value in dataclasses.asdict(options).items() if value is not None}
    for key in ("shapes", "codes"):
        if key in changes:
            changes[key] = tuple(part.strip() for part in changes[key].split(",") if part.strip())
    try:
        return dataclasses.replace(settings, **changes)
    except InputError as error:
        option = f"--{error.where.rpartition('.')[2].replace('_', '-')}"
        raise InputError(option, error.fact, error.remedy) from error
