"""Inputs of an experiment file that is written on the spot."""

from pathlib import Path

from grainmotion.experiment.config import read_experiment
from grainmotion.experiment.inputs import Inputs, find_inputs


def inputs_of(folder: Path, toml: str) -> Inputs:
    (folder / "changed.toml").write_text(toml)
    return find_inputs(read_experiment(folder / "changed.toml"))
