"""`grainmotion plan`: before beam time."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

import grainmotion as gm
from grainmotion.cli.command import current_call
from grainmotion.cli.completion import complete_experiment
from grainmotion.cli.options import Display, PlanOptions, Seed
from grainmotion.cli.outcome import Outcome
from grainmotion.cli.progress import progress
from grainmotion.cli.stages import read
from grainmotion.cli.words import CaseName
from grainmotion.errors import InputError

if TYPE_CHECKING:
    from grainmotion.cli.terminal import Terminal
    from grainmotion.planning.plan import Plan

PlanFile = Annotated[
    Path | None,
    typer.Argument(
        metavar="FILE", help="experiment file (TOML) with the reference", autocompletion=complete_experiment
    ),
]
Case = Annotated[CaseName | None, typer.Option("--case", help="a simulated packing instead of a file")]
PlanOut = Annotated[Path | None, typer.Option("--out", help="folder in which plan/ is made")]


def plan(
    file: PlanFile = None,
    *,
    case: Case = None,
    options: PlanOptions,
    out: PlanOut = None,
    seed: Seed = 0,
    display: Display,
) -> Outcome:
    """Predict precision and capture range for 2, 3, 4, 6 views of a sample, and find the best angles.

    Example: grainmotion plan experiment.toml --photons 20000

    Example: grainmotion plan --case paper --views 2,4
    """
    from grainmotion.cli.json_output import plan_outcome
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
    call = current_call()
    with progress(display.terminal, call.stop, found=call.found) as listener:
        if experiment is not None:
            result, folder = plan_experiment(experiment, settings, out=out, progress=listener)
        else:
            assert case is not None
            result, folder = plan_case(
                case.value, settings, out=out or Path(), photons=options.photons, seed=seed, progress=listener
            )
    return Outcome(plan_outcome(result, folder), lambda terminal: _show(terminal, result, folder), tuple(call.found))


def _show(terminal: Terminal, result: Plan, folder: Path) -> None:
    """Print the table, and where the files are."""
    from grainmotion.cli.tables import print_plan

    print_plan(terminal, result)
    print(f"plan: {folder}")


def _counts(text: str | None) -> tuple[int, ...] | None:
    """The numbers of ``2,3,4``."""
    if text is None:
        return None
    try:
        return tuple(int(part) for part in text.split(","))
    except ValueError:
        raise InputError("--views", f"'{text}' is no list of whole numbers", "give them as 2,3,4,6") from None
