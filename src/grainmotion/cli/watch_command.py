"""`grainmotion watch`: states tracked as their radiographs arrive."""

from __future__ import annotations

from typing import Annotated

import typer

from grainmotion.cli import console
from grainmotion.cli.findings import exit_by
from grainmotion.cli.options import Checks, Execution, OnDevice, Paths
from grainmotion.cli.stages import prepared, read

Every = Annotated[float, typer.Option("--every", help="seconds between two looks at the folders")]
Until = Annotated[int | None, typer.Option("--until", help="end once this many states are tracked")]
StopAfter = Annotated[
    float | None, typer.Option("--stop-after", help="end after this many seconds without a new or changed file")
]


def watch(
    paths: Paths,
    *,
    every: Every = 1.0,
    until: Until = None,
    stop_after: StopAfter = None,
    device: OnDevice = None,
    execution: Execution,
    checks: Checks,
) -> None:
    """Track each state as soon as its radiographs are complete, with a live page; Ctrl-C ends it.

    Example: grainmotion watch experiment.toml --stop-after 3600
    """
    from grainmotion.workflow.watch import WatchSettings
    from grainmotion.workflow.watch import watch as watch_states

    settings = WatchSettings(every, until, stop_after)
    with prepared(read(paths.file, device), execution, checks) as (experiment, options):
        result = watch_states(experiment, out=paths.out, settings=settings, say=_say, **options)
    console.print_states(result.motions)
    count = len(result.motions)
    tracked = f"{count} state{'s' * (count != 1)} tracked"
    print(f"watch ended: {'; '.join(dict.fromkeys([result.ended, tracked]))}; page: {result.page}")
    if not result.interrupted:
        exit_by(result.motions, result.findings, strict=checks.strict)


def _say(line: str) -> None:
    print(line, flush=True)
