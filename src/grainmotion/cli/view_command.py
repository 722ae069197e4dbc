"""`grainmotion view`: the results of a run in windows of napari."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from grainmotion.cli.command import current_call
from grainmotion.cli.completion import complete_experiment
from grainmotion.cli.no_experiment import EXPERIMENT
from grainmotion.cli.options import Display, Out
from grainmotion.cli.outcome import Outcome
from grainmotion.cli.progress import progress
from grainmotion.cli.stages import read

Place = Annotated[
    Path,
    typer.Argument(
        metavar="FILE",
        help="experiment file (TOML), its folder, or a folder of results",
        autocompletion=complete_experiment,
    ),
]
Value = Annotated[
    str, typer.Option("--value", help="colour of the grains: u, w, sd_u, sd_w, status, residual, uz, ...")
]


def view(place: Place, *, value: Value = "u", out: Out = None, display: Display) -> Outcome:
    """Show grains, tracks, displacements and residual radiographs in napari, which the extra viewer brings.

    Example: grainmotion view experiment.toml --value status
    """
    import grainmotion as gm
    from grainmotion.cli.documents import ViewOutcome

    if (place / EXPERIMENT).is_file():
        place = place / EXPERIMENT
    folder = place if place.is_dir() else out or read(place).output
    with progress(display.terminal, current_call().stop) as listener:
        listener("opening the results", 0, 2)
        results = gm.read_results(folder)
        gm.viewer.open(results, value=value)
        listener("opening the residual radiographs", 1, 2)
        if gm.viewer.residual_layers(results):
            gm.viewer.open_residuals(results)
    import napari

    napari.run()
    return Outcome(ViewOutcome(str(folder.absolute())), lambda _terminal: None)
