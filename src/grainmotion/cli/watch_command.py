"""`grainmotion watch`: states tracked as their radiographs arrive."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING

from grainmotion.cli.options import Checks, Display, Execution, OnDevice, Paths, WatchOptions
from grainmotion.cli.outcome import Ending, Outcome, ending_by
from grainmotion.cli.stages import prepared, read

if TYPE_CHECKING:
    from grainmotion.cli.terminal import Terminal
    from grainmotion.workflow.watch_session import WatchResult


def watch(
    paths: Paths,
    *,
    options: WatchOptions,
    device: OnDevice = None,
    execution: Execution,
    checks: Checks,
    display: Display,
) -> Outcome:
    """Track each state as soon as its radiographs are complete, with a live page; Ctrl-C ends it.

    Example: grainmotion watch experiment.toml --stop-after 3600
    """
    from grainmotion.cli.documents import WatchOutcome
    from grainmotion.cli.json_output import state_result
    from grainmotion.workflow.provenance import StageCache
    from grainmotion.workflow.watch import WatchSettings
    from grainmotion.workflow.watch import watch as watch_states

    settings = WatchSettings(**dataclasses.asdict(options))
    with prepared(read(paths.file, device), execution, checks, display) as (experiment, run_options):
        result = watch_states(experiment, out=paths.out, settings=settings, say=display.terminal.say, **run_options)
    folder = result.folder.absolute()
    files = sorted({file.absolute() for file in StageCache(folder).all_files()})
    states = [state_result(name, motions, folder, files) for name, motions in result.motions.items()]
    document = WatchOutcome(str(folder), str(result.page.absolute()), result.ended, states)
    ending = Ending() if result.interrupted else ending_by(result.motions, result.findings, strict=checks.strict)
    return Outcome(document, lambda terminal: _show(terminal, result), result.findings, ending)


def _show(terminal: Terminal, result: WatchResult) -> None:
    """Print the states, and why the watch ended."""
    from grainmotion.cli.summary import print_states

    print_states(terminal, result.motions)
    count = len(result.motions)
    tracked = f"{count} state{'s' * (count != 1)} tracked"
    print(f"watch ended: {'; '.join(dict.fromkeys([result.ended, tracked]))}; page: {result.page}")
