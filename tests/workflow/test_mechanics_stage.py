"""`export mechanics`, and exports = ["mechanics"] in an experiment file."""

from __future__ import annotations

import json

import pytest
from typer.testing import CliRunner

from grainmotion.cli import app
from grainmotion.experiment.config import read_experiment
from grainmotion.io.mechanics_files import mechanics_names
from grainmotion.workflow.run import run
from tiny_experiment import SHIFTS, write_tiny


@pytest.fixture(scope="module")
def exported(tmp_path_factory):
    path = write_tiny(tmp_path_factory.mktemp("mechanics"))
    return path, CliRunner().invoke(app.app, ["export", "mechanics", str(path), "--quiet"])


def test_files_of_the_reference_and_of_each_state(exported):
    path, result = exported
    assert result.exit_code == 0, result.output
    results = path.parent / "results"
    for name in SHIFTS:
        assert f"mechanics: {results / name / 'mechanics.json'}" in result.output.replace("\n", "")
        assert all((results / name / file).is_file() for file in mechanics_names(state=True))
    assert all((results / file).is_file() for file in mechanics_names("reference_", state=False))
    assert not (results / "one" / "grains.vtp").exists()


def test_only_changed_settings_are_done_again(exported):
    path, _ = exported
    text = path.read_text() + '\n[output]\nexports = ["mechanics"]\n'
    path.write_text(text)
    assert run(read_experiment(path)).done == ()
    path.write_text(text + "\n[mechanics]\ntolerance = 0.8\n")
    assert run(read_experiment(path)).done == ("reference/mechanics", "one/mechanics", "two/mechanics")
    found = json.loads((path.parent / "results" / "one" / "mechanics.json").read_text())
    assert found["settings"]["tolerance"] == 0.8


def test_a_wrong_setting_is_named(exported):
    path, _ = exported
    for line, fact in (
        ("tolerance = 0", "greater than 0"),
        ('estimator = "delaunay"', "cells"),
        ("gap = 1", "unknown"),
    ):
        wrong = path.with_name("wrong.toml")
        wrong.write_text(path.read_text().partition("[mechanics]")[0] + f"\n[mechanics]\n{line}\n")
        result = CliRunner().invoke(app.app, ["export", "mechanics", str(wrong), "--quiet"])
        assert result.exit_code != 0
        assert fact in result.output
        assert "mechanics" in result.output
        assert "Traceback" not in result.output
