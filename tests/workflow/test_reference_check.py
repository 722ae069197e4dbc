"""A wrong geometry of the reference stops a run, and ``try_fixes`` undoes it, end to end."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from tests.tiny_experiment import SHIFTS, TOML, VIEWS, geometry, write_tiny

import grainmotion as gm
from grainmotion.experiment.config import Experiment
from grainmotion.io.geometry_csv import write_geometry


def negated(folder: Path, check: str = "") -> Experiment:
    """The tiny experiment, its reference's stage turning the other way than told."""
    path = write_tiny(folder, TOML + check)
    write_geometry(folder / "reference.csv", geometry(-np.arange(VIEWS) * 360 / VIEWS))
    return gm.read_experiment(path)


def test_wrong_sense_of_rotation_stops_the_run(tmp_path):
    with pytest.raises(gm.InputError, match=r"mirrored.*standard errors.*--force"):
        gm.run(negated(tmp_path), until="segment")


def test_try_fixes_gives_the_true_motions_and_says_so(tmp_path):
    result = gm.run(negated(tmp_path, "\n[check]\ntry_fixes = true\n"))
    (finding,) = [f for f in result.findings if f.fix]
    assert (finding.level, finding.fix) == (gm.Level.WARNING, "angles-negated")
    assert 'fixes = ["angles-negated"]' in finding.remedy
    for name, shift in SHIFTS.items():
        np.testing.assert_allclose(result.motions[name].translations, [shift] * 3, atol=0.02)
