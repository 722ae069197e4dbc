"""The reference scan of an experiment file, as ``grainmotion run`` reads it."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from grainmotion.experiment.config import read_experiment
from grainmotion.experiment.inputs import find_inputs
from grainmotion.experiment.scan_inputs import ScanInput
from lab_scanner import ball_images


def reference_of(folder: Path, text: str) -> ScanInput:
    """The reference of an experiment file with this text."""
    (folder / "experiment.toml").write_text(text)
    source = find_inputs(read_experiment(folder / "experiment.toml")).reference
    assert source is not None
    return source


def misfit(source: ScanInput) -> float:
    """Largest difference between the radiographs and those that the object of balls gives in the geometry."""
    return float(np.abs(source.read()[0].line_integrals - ball_images(source.geometry)).max())
