"""`grainmotion export`: files for other software.

`grainmotion export FILE --format vtk` is older than the subcommands and stays: arguments that begin with no subcommand
are those of `files`.
"""

from __future__ import annotations

import dataclasses
from enum import StrEnum
from functools import partial
from typing import Annotated

import typer
from typer.core import TyperGroup

import grainmotion as gm
from grainmotion.cli.findings import EXIT_CODES
from grainmotion.cli.options import Checks, Execution, Paths, command
from grainmotion.cli.stages import finish, prepared, read

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
    help="Write results for other software: `export FILE --format vtk`, or one of the commands below.",
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


class SpamPoint(StrEnum):
    """The point whose displacement a file for spam gives."""

    CENTROID = "centroid"
    BOX = "box"


@add_command
def files(
    paths: Paths,
    *,
    format: Annotated[
        list[Format], typer.Option("--format", help="vtk for ParaView, tiff for Fiji, ome-zarr for napari, spam")
    ],
    about: Annotated[
        SpamPoint | None,
        typer.Option("--about", help="spam: displacement of the label's centroid, or of its bounding box' middle"),
    ] = None,
    execution: Execution,
    checks: Checks,
) -> None:
    """Write the motions for other software (the word `files` may be left out); missing stages are done first."""
    experiment = read(paths.file)
    wanted = sorted({*experiment.tables.output.exports, *(f.value for f in format)})
    changes = {"exports": wanted} if about is None else {"exports": wanted, "spam_about": about.value}
    output = experiment.tables.output.model_copy(update=changes)
    tables = experiment.tables.model_copy(update={"output": output})
    with prepared(dataclasses.replace(experiment, tables=tables), execution, checks) as (experiment, options):
        result = gm.run(experiment, out=paths.out, **options)
    finish(result, execution, checks, *(f"exported: {result.folder / name}" for name in result.motions))


@add_command
def mechanics(paths: Paths, *, execution: Execution, checks: Checks) -> None:
    """Write strains, contacts, fabric and void ratios of the reference and of each state, as [mechanics] says."""
    experiment = read(paths.file)
    wanted = [
        *experiment.tables.output.exports,
        *([] if "mechanics" in experiment.tables.output.exports else ["mechanics"]),
    ]
    output = experiment.tables.output.model_copy(update={"exports": wanted})
    tables = experiment.tables.model_copy(update={"output": output})
    with prepared(dataclasses.replace(experiment, tables=tables), execution, checks) as (experiment, options):
        result = gm.run(experiment, out=paths.out, **options)
    finish(
        result, execution, checks, *(f"mechanics: {result.folder / name / 'mechanics.json'}" for name in result.motions)
    )
