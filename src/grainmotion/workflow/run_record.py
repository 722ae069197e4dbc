"""What the report tells of the run itself: command, settings, machine and inputs, enough to make the results again."""

from __future__ import annotations

import shlex
from importlib import metadata
from pathlib import Path

from grainmotion.errors import InputError
from grainmotion.experiment.config import Experiment, read_experiment
from grainmotion.experiment.inputs import Inputs
from grainmotion.report.data import RunRecord
from grainmotion.workflow.log import changed_settings, input_stacks, machine, toml_lines
from grainmotion.workflow.versions import package_versions


def run_record(experiment: Experiment, inputs: Inputs, folder: Path) -> RunRecord:
    """The record of a run whose results are in ``folder``."""
    stacks = ((name, stack.spec, len(set(stack.files))) for name, stack in input_stacks(inputs))
    return RunRecord(
        command=reproducing_command(experiment, folder),
        settings="\n".join(toml_lines(changed_settings(experiment))).replace("\n[", "\n\n["),
        versions=(("grainmotion", metadata.version("grainmotion")), *package_versions().items()),
        machine=machine(),
        folder=str(folder.absolute()),
        inputs=tuple((name, f"{spec}, {files} file{'s' * (files != 1)}") for name, spec, files in stacks),
    )


def reproducing_command(experiment: Experiment, folder: Path) -> str:
    """The command that makes the results again, with the options that differ from the experiment file.

    The number of workers and the progress shown are left out, as results do not depend on them.
    """
    words = ["grainmotion", "run", str(experiment.path.absolute())]
    if folder.absolute() != experiment.output.absolute():
        words += ["--out", str(folder.absolute())]
    try:
        told = read_experiment(experiment.path).tables
    except InputError:  # changed or moved since it was read: the settings on the page say all
        return shlex.join(words)
    used = experiment.tables
    if used.track.device != told.track.device:
        words += ["--device", used.track.device]
    words += ["--force"] * (used.check.force and not told.check.force)
    words += ["--try-fixes"] * (used.check.try_fixes and not told.check.try_fixes)
    return shlex.join(words)
