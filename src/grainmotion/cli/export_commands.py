"""`grainmotion export`: files for other software.

`grainmotion export FILE --format vtk` is older than the subcommands and stays: arguments that begin with no subcommand
are those of `files`.
"""

from __future__ import annotations

import dataclasses
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from grainmotion.cli.command import HELP_OPTIONS, add_command
from grainmotion.cli.exit_codes import EPILOG
from grainmotion.cli.options import Checks, DemOptions, Display, DryRun, Execution, Paths
from grainmotion.cli.program import Suggesting
from grainmotion.cli.stages import StagesCall, StagesToRun, read, run_stages
from grainmotion.cli.words import Format, SpamPoint
from grainmotion.errors import InputError

if TYPE_CHECKING:
    from grainmotion.experiment.config import Experiment, Export
    from grainmotion.grain_shapes.settings import DemSettings
    from grainmotion.workflow.run import RunResult

DEFAULT_EXPORT = "files"

Formats = Annotated[
    list[Format],
    typer.Option(
        "--format",
        help="vtk for ParaView, tiff for Fiji, ome-zarr for napari, spam, dem, mechanics; repeat it for several",
    ),
]
About = Annotated[
    SpamPoint | None,
    typer.Option("--about", help="spam: displacement of the label's centroid, or of the middle of its bounding box"),
]


class ExportGroup(Suggesting):
    """Subcommands of `export`; arguments that begin with an option or a file are those of `files`."""

    def meant_by(self, word: str) -> str | None:
        """`files` for an option or a path, but not for a mistyped subcommand."""
        is_path = Path(word).suffix != "" or "/" in word or Path(word).exists()
        return DEFAULT_EXPORT if word.startswith("-") or is_path else None


export_app = typer.Typer(
    name="export",
    cls=ExportGroup,
    help="Write results for other software.\n\nExample: grainmotion export experiment.toml --format vtk",
    epilog=EPILOG,
    no_args_is_help=True,
    context_settings=HELP_OPTIONS,
)


def files(
    paths: Paths,
    *,
    format: Formats,
    about: About = None,
    dry_run: DryRun = False,
    execution: Execution,
    checks: Checks,
    display: Display,
) -> StagesToRun:
    """Write files for other software; the word `files` may be left out. Stages that are missing are done first.

    Example: grainmotion export experiment.toml --format vtk --format tiff
    """
    changes = {} if about is None else {"spam_about": about.value}
    wanted = _with_exports(read(paths.file), [f.value for f in format], **changes)

    def lines(result: RunResult) -> list[str]:
        from grainmotion.workflow.exports import exported_files

        state = next(iter(result.motions)) if len(result.motions) == 1 else "STATE"
        names = exported_files([f.value for f in format], state)
        names += [f"{state}/mechanics.json"] if Format.MECHANICS in format else []
        names += ["dem"] if Format.DEM in format else []
        return [f"exported: {result.folder / name}" for name in names]

    return partial(run_stages, wanted, StagesCall(paths.out, execution, checks, dry_run, display), lines=lines)


def mechanics(
    paths: Paths, *, dry_run: DryRun = False, execution: Execution, checks: Checks, display: Display
) -> StagesToRun:
    """Write strains, contacts, fabric and void ratios of the reference and of each state.

    The table mechanics of the experiment file has the settings.

    Example: grainmotion export mechanics experiment.toml
    """

    def lines(result: RunResult) -> list[str]:
        return [f"mechanics: {result.folder / name / 'mechanics.json'}" for name in result.motions]

    wanted = _with_exports(read(paths.file), ["mechanics"])
    return partial(run_stages, wanted, StagesCall(paths.out, execution, checks, dry_run, display), lines=lines)


def dem(
    paths: Paths,
    *,
    options: DemOptions,
    dry_run: DryRun = False,
    execution: Execution,
    checks: Checks,
    display: Display,
) -> StagesToRun:
    """Write each grain as a rigid body for DEM codes: STL, level set, clump, harmonics, inertia, poses, velocities.

    The table dem of the experiment file has the settings; options replace them.

    Example: grainmotion export dem experiment.toml --shapes stl,clump --spheres 40
    """
    experiment = _with_exports(read(paths.file), ["dem"])
    settings = _dem_settings(experiment.tables.dem, options)
    wanted = dataclasses.replace(experiment, tables=experiment.tables.model_copy(update={"dem": settings}))
    call = StagesCall(paths.out, execution, checks, dry_run, display)
    return partial(run_stages, wanted, call, lines=lambda result: [f"exported: {result.folder / 'dem'}"])


for export in (files, mechanics, dem):
    add_command(export_app, export)


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
