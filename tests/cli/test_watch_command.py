"""`grainmotion watch`: tracks what is there, tells each state in a line, and ends by its options with exit code 0."""

import shutil
import signal
import subprocess
import sys

import numpy as np
import pytest
from typer.testing import CliRunner

from grainmotion.cli import app
from grainmotion.io.motions_csv import read_motions
from tiny_experiment import SHIFTS, TOML, write_tiny

COMMAND = [sys.executable, "-c", "from grainmotion.__main__ import main; main()"]


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    return write_tiny(tmp_path_factory.mktemp("tiny"))


def invoke(*arguments):
    return CliRunner().invoke(app.app, [str(argument) for argument in arguments])


def test_states_that_are_there_are_tracked(path):
    result = invoke("watch", path, "--every", 0.02, "--quiet")
    assert result.exit_code == 0, result.output
    assert "one: 3 translations, 0 rotations of 3 usable" in result.output
    assert "largest displacement" in result.output
    assert "watch ended: all states of the file are tracked; 2 states tracked" in result.output
    motions = read_motions(path.parent / "results" / "two" / "motions.csv")
    np.testing.assert_allclose(motions.translations, np.tile(SHIFTS["two"], (3, 1)), atol=0.02)
    again = invoke("run", path)
    assert "done: nothing" in again.output


def test_it_ends_by_its_options(path, tmp_path):
    text = path.read_text() + '\n[watch]\nfolders = "later/*"\n'
    other = path.with_name("watch.toml")
    other.write_text(text)
    result = invoke("watch", other, "--every", 0.02, "--until", 1, "--out", tmp_path / "out", "--quiet")
    assert "states tracked" in result.output
    result = invoke("watch", other, "--every", 0.02, "--stop-after", 0.05, "--out", tmp_path / "out", "--quiet")
    assert "no file changed for 0.05 s" in result.output
    assert result.exit_code == 0


def test_folders_are_found_from_any_working_folder(path, monkeypatch):
    """The file is named from the folder above its own."""
    steps = path.parent / "steps" / "s1"
    steps.mkdir(parents=True)
    shutil.copy(path.parent / "one.tif", steps)
    other = path.with_name("folders.toml")
    other.write_text(TOML[: TOML.index("[[states]]")] + '[watch]\nfolders = "steps/*"\ngeometry = "one.csv"\n')
    monkeypatch.chdir(path.parents[1])
    result = invoke("watch", f"{path.parent.name}/folders.toml", "--every", 0.02, "--until", 1, "--quiet")
    assert "s1: 3 translations" in result.output
    assert "done: nothing" in invoke("run", f"{path.parent.name}/folders.toml").output


@pytest.mark.parametrize("option", [("--every", 0), ("--until", 0), ("--stop-after", -1)])
def test_options_that_cannot_be_are_refused_in_one_line(path, option):
    result = invoke("watch", path, *option)
    assert result.exit_code == 2
    assert option[0] in result.output
    assert "Traceback" not in result.output


def test_an_interrupt_from_the_keyboard_ends_it_cleanly(path):
    """The whole command, waiting for folders that never come, is sent what Ctrl-C sends."""
    waiting = path.with_name("waiting.toml")
    waiting.write_text(TOML[: TOML.index("[[states]]")] + '[watch]\nfolders = "nowhere/*"\ngeometry = "one.csv"\n')
    command = [*COMMAND, "watch", waiting, "--out", path.parent / "waiting", "--quiet", "--every", "0.05"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert "watching; live page" in process.stdout.readline()
        process.send_signal(signal.SIGINT)
        output, errors = process.communicate(timeout=120)
    assert process.returncode == 0, errors
    assert "watch ended: interrupted" in output
    assert "Traceback" not in errors
