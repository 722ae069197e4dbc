"""`grainmotion simulate` and `grainmotion demo`: experiments whose true motions are known."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from grainmotion.cli.command import current_call
from grainmotion.cli.options import Display, OnDevice, Seed
from grainmotion.cli.outcome import Outcome, ending_by
from grainmotion.cli.progress import progress
from grainmotion.cli.words import DatasetName

if TYPE_CHECKING:
    from grainmotion.cli.demo import Demo
    from grainmotion.cli.terminal import Terminal

Simulated = Annotated[Path, typer.Argument(metavar="OUTDIR", help="folder for the experiment")]
DemoFolder = Annotated[Path, typer.Argument(metavar="OUTDIR", help="folder for data and results")]
Dataset = Annotated[
    DatasetName, typer.Option("--case", help="6 grains in seconds, the paper's scale, or a hard case of 6 to 24 grains")
]


def simulate(folder: Simulated, case: Dataset = DatasetName.SMALL, seed: Seed = 0, *, display: Display) -> Outcome:
    """Simulate an experiment with its true motions: radiographs, flats, darks, geometry and experiment.toml.

    Example: grainmotion simulate noisy-sample --case noisy
    """
    from grainmotion.cli.demo import write_case
    from grainmotion.cli.documents import SimulateOutcome

    with progress(display.terminal, current_call().stop) as listener:
        path = write_case(folder, case.value, seed, progress=listener)

    def show(_terminal: Terminal) -> None:
        print(f"experiment: {path}")
        print(f"next: grainmotion run {path}")

    return Outcome(SimulateOutcome(str(path.absolute())), show)


def demo(
    folder: DemoFolder = Path("grainmotion-demo"), seed: Seed = 0, device: OnDevice = None, *, display: Display
) -> Outcome:
    """Simulate a small packing, measure its motions, and compare them with the true ones; takes about a minute.

    Example: grainmotion demo my-demo
    """
    from grainmotion.cli.demo import run_demo
    from grainmotion.cli.documents import DemoOutcome
    from grainmotion.cli.json_output import comparison_outcomes, run_outcome

    call = current_call()
    with progress(display.terminal, call.stop, found=call.found) as listener:
        made = run_demo(folder, seed, device=device.value if device else "auto", progress=listener)
    result = made.result
    experiment = str((folder / "experiment.toml").absolute())
    document = DemoOutcome(experiment, run_outcome(result), comparison_outcomes(made.comparisons))
    ending = ending_by(result.motions, (), strict=False)
    return Outcome(document, lambda terminal: _show(terminal, made), result.findings, ending)


def _show(terminal: Terminal, made: Demo) -> None:
    """Print the errors, the findings, where the results are, and how to go on with a scan of one's own."""
    from grainmotion.cli.summary import places, print_findings
    from grainmotion.cli.tables import print_comparisons

    print_comparisons(terminal, made.comparisons)
    print("translations, rotations: grains whose translation, rotation is a result to use")
    print("errors: root mean squares of single components, against the true motions")
    print_findings(terminal, made.result.findings)
    for line in places(made.result):
        print(line)
    print("next: open the report in a browser; with your own scan in the folder FOLDER: grainmotion init FOLDER")
