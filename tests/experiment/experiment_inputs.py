"""Helper: inputs of an experiment file with the given text."""

from pathlib import Path

from grainmotion.experiment.config import read_experiment
from grainmotion.experiment.inputs import Inputs, find_inputs


def inputs_of(folder: Path, toml: str) -> Inputs:
    """Write the text to an experiment file in the folder and find its inputs."""
    (folder / "changed.toml").write_text(toml)
    return find_inputs(read_experiment(folder / "changed.toml"))
