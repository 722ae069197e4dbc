"""Options that commands share, in records; `grainmotion.cli.command` makes parameters of their fields.

``--help`` shows options in panels: results, checks, computing, output.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from grainmotion.backends.device import Device
from grainmotion.cli.completion import complete_experiment
from grainmotion.cli.terminal import Terminal
from grainmotion.cli.words import ColorWhen

if TYPE_CHECKING:
    from grainmotion.cluster.connection import ComputeConfig

CHECKS_PANEL, COMPUTING_PANEL, OUTPUT_PANEL = "Checks", "Computing", "Output"
"""Panels of options."""

File = Annotated[
    Path, typer.Argument(metavar="FILE", help="experiment file (TOML)", autocompletion=complete_experiment)
]
Out = Annotated[Path | None, typer.Option("--out", help="folder for results, instead of the file's own")]
DryRun = Annotated[
    bool, typer.Option("--dry-run", help="tell what would be done and what it would need; write nothing")
]
Force = Annotated[
    bool,
    typer.Option("--force", help="go on where a check of the input would stop the work", rich_help_panel=CHECKS_PANEL),
]
TryFixes = Annotated[
    bool,
    typer.Option("--try-fixes", help="apply what a check found to be clearly better", rich_help_panel=CHECKS_PANEL),
]
Strict = Annotated[
    bool, typer.Option("--strict", help="end with exit code 3 if there is any warning", rich_help_panel=CHECKS_PANEL)
]
Scheduler = Annotated[
    str | None,
    typer.Option(
        "--scheduler", help="address of a Dask scheduler whose workers compute", rich_help_panel=COMPUTING_PANEL
    ),
]
Workers = Annotated[
    int | None,
    typer.Option("--workers", help="number of worker processes on this machine", rich_help_panel=COMPUTING_PANEL),
]
Memory = Annotated[
    str | None,
    typer.Option(
        "--memory",
        metavar="SIZE",
        help="memory that a process may use, as 8GB, instead of what is free; large arrays that exceed it go to files",
        rich_help_panel=COMPUTING_PANEL,
    ),
]
OnDevice = Annotated[
    Device | None,
    typer.Option("--device", help="where rays are traced, instead of the file's own", rich_help_panel=COMPUTING_PANEL),
]
Json = Annotated[
    bool, typer.Option("--json", help="one JSON document on standard output, all else on standard error",
                       rich_help_panel=OUTPUT_PANEL)
]  # fmt: skip
Quiet = Annotated[
    bool, typer.Option("--quiet", "-q", help="no progress and no notes; warnings stay", rich_help_panel=OUTPUT_PANEL)
]
Verbose = Annotated[
    bool, typer.Option("--verbose", "-v", help="also times of stages, and files as they are written",
                       rich_help_panel=OUTPUT_PANEL)
]  # fmt: skip
Color = Annotated[
    ColorWhen, typer.Option("--color", help="colours; auto: on a terminal, unless NO_COLOR is set",
                            rich_help_panel=OUTPUT_PANEL)
]  # fmt: skip
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
Every = Annotated[float, typer.Option("--every", help="seconds between two looks at the folders")]
Until = Annotated[int | None, typer.Option("--until", help="end once this many states are tracked")]
StopAfter = Annotated[
    float | None, typer.Option("--stop-after", help="end after this many seconds without a new or changed file")
]


@dataclass(frozen=True)
class Paths:
    """The experiment, and where its results go."""

    file: File
    out: Out = None


@dataclass(frozen=True)
class Execution:
    """Which processes compute."""

    scheduler: Scheduler = None
    workers: Workers = None
    memory: Memory = None

    @property
    def workplace(self) -> ComputeConfig:
        """The same for the code that computes; raises `InputError` where it cannot be."""
        from grainmotion.cluster.connection import ComputeConfig

        return ComputeConfig(self.scheduler, self.workers, self.memory)


@dataclass(frozen=True)
class Checks:
    """What follows from the findings of checks."""

    force: Force = False
    try_fixes: TryFixes = False
    strict: Strict = False


@dataclass(frozen=True)
class Display:
    """What is told, in which form; every command has it."""

    json: Json = False
    quiet: Quiet = False
    verbose: Verbose = False
    color: Color = ColorWhen.AUTO

    @property
    def terminal(self) -> Terminal:
        """The same for the code that prints."""
        return Terminal(self.json, self.quiet, self.verbose, self.color)


@dataclass(frozen=True)
class PlanOptions:
    """Settings of ``[plan]`` that the command line replaces."""

    photons: Photons = None
    views: Views = None
    step_deg: StepDeg = None


@dataclass(frozen=True)
class DemOptions:
    """Settings of ``[dem]`` that the command line replaces."""

    shapes: Shapes = None
    codes: Codes = None
    spacing: Spacing = None
    spheres: Spheres = None
    clump_fit: FitOfClump = None
    degree: Degree = None


@dataclass(frozen=True)
class WatchOptions:
    """How long `watch` watches."""

    every: Every = 1.0
    until: Until = None
    stop_after: StopAfter = None


OPTION_RECORDS: tuple[type, ...] = (Paths, Execution, Checks, Display, PlanOptions, DemOptions, WatchOptions)
