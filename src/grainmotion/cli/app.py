"""The command line: all commands, in the panels of ``grainmotion --help``."""

from __future__ import annotations

from importlib import metadata
from typing import Annotated

import typer

from grainmotion.cli.command import HELP_OPTIONS, add_command
from grainmotion.cli.exit_codes import EPILOG
from grainmotion.cli.export_commands import export_app
from grainmotion.cli.inspect_commands import init, inspect
from grainmotion.cli.options import Display
from grainmotion.cli.outcome import Outcome
from grainmotion.cli.plan_command import plan
from grainmotion.cli.program import NAME, Program
from grainmotion.cli.run_commands import reconstruct, report, run, segment, track
from grainmotion.cli.simulate_commands import demo, simulate
from grainmotion.cli.terminal import Terminal
from grainmotion.cli.view_command import view
from grainmotion.cli.watch_command import watch

START_PANEL, MAIN_PANEL, STAGES_PANEL = "Start here", "The main job", "Its stages, one by one"
RESULTS_PANEL, BEFORE_PANEL, ABOUT_PANEL = (
    "Look at results, and take them elsewhere",
    "Before beam time",
    "About the program",
)
"""Panels of commands."""
HELP = f"""The rigid motion of every grain of a sample, from one full scan and a few radiographs per state.

Try it: {NAME} demo

With your own scan in the folder measurements: {NAME} init measurements, then {NAME} run measurements/experiment.toml.

A file or folder instead of a command is inspected."""

app = typer.Typer(
    name=NAME,
    cls=Program,
    help=HELP,
    epilog=EPILOG,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    context_settings=HELP_OPTIONS,
)


def _version(wanted: bool) -> None:
    if wanted:
        print(f"{NAME} {metadata.version(NAME)}")
        raise typer.Exit


@app.callback()
def options(
    version: Annotated[
        bool, typer.Option("--version", "-V", callback=_version, is_eager=True, help="print the version")
    ] = False,
) -> None:
    """Options of the program itself; its help is `HELP`."""


def show_version(*, display: Display) -> Outcome:
    """Print the version, with --verbose also those of Python and of the libraries that compute.

    Example: grainmotion version --verbose
    """
    from grainmotion.cli.documents import VersionOutcome
    from grainmotion.workflow.versions import package_versions

    versions = package_versions()
    document = VersionOutcome(metadata.version(NAME), versions.pop("Python"), versions)

    def show(terminal: Terminal) -> None:
        print(document.version)
        if terminal.verbose:
            for name, number in {"Python": document.python_version, **document.packages}.items():
                print(f"{name} {number}")

    return Outcome(document, show)


for function, panel in (
    (demo, START_PANEL),
    (inspect, START_PANEL),
    (init, START_PANEL),
    (run, MAIN_PANEL),
    (watch, MAIN_PANEL),
    (reconstruct, STAGES_PANEL),
    (segment, STAGES_PANEL),
    (track, STAGES_PANEL),
    (report, STAGES_PANEL),
    (view, RESULTS_PANEL),
):
    add_command(app, function, panel)
app.add_typer(export_app, name="export", rich_help_panel=RESULTS_PANEL)
add_command(app, plan, BEFORE_PANEL)
add_command(app, simulate, BEFORE_PANEL)
add_command(app, show_version, ABOUT_PANEL, name="version")
