"""Ctrl-C at any step of a run: the exit code, the message, nothing half written, and a run that goes on from there."""

import signal
import subprocess
import sys

import pytest
from typer.testing import CliRunner

from grainmotion.cli.app import app
from grainmotion.cli.interrupts import INTERRUPTED
from grainmotion.model import progress
from grainmotion.workflow.folder_lock import LOCK_FILE
from tiny_experiment import write_tiny

STEPS = (
    "reading the reference scan (pixels)", "checking the reference scan (sense", "reconstruct: SART sweep 2",
    "segment: cutting the grains", "segment: writing", "one: free", "two: residuals", "report (radiographs)",
)  # fmt: skip


@pytest.fixture
def default_sigint():
    """Python's own SIGINT handler, which a shell's background jobs lack and which other tests may replace."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.fixture(scope="module")
def experiment(tmp_path_factory):
    """One experiment: each interrupted run goes on where the one before it was interrupted."""
    path = write_tiny(tmp_path_factory.mktemp("interrupted"))
    path.write_text(path.read_text().replace("[track]", '[output]\nexports = ["vtk"]\n\n[track]'))
    return path


def run(path, monkeypatch, step):
    """Run the experiment; Ctrl-C comes when a message begins with ``step``, inside its loops."""
    told = progress.Listener.inside

    def inside(listener, share):
        told(listener, share)
        message = f"{listener.step[0]} ({listener.what})" if listener.what else listener.step[0]
        if step and message.startswith(step):
            signal.raise_signal(signal.SIGINT)

    with monkeypatch.context() as patch:
        patch.setattr(progress.Listener, "inside", inside)
        return CliRunner().invoke(app, ["run", str(path)])


@pytest.mark.usefixtures("default_sigint")
@pytest.mark.parametrize("step", STEPS)
def test_interrupted_inside_a_step(experiment, monkeypatch, step):
    result = run(experiment, monkeypatch, step)
    assert result.exit_code == 130, result.output
    assert result.stderr.splitlines()[-1] == INTERRUPTED
    assert not [path for path in experiment.parent.rglob(".*") if path.name != LOCK_FILE]


@pytest.mark.usefixtures("default_sigint")
def test_the_same_command_goes_on(experiment, monkeypatch):
    result = run(experiment, monkeypatch, "")
    assert result.exit_code == 0, result.output
    done, kept = result.stdout.splitlines()[0].split("; kept: ")
    assert "report" in done
    assert {"reconstruct", "segment", "one/track", "two/track"} <= set(kept.split(", "))


SLOW = """
import os, signal, sys, threading, time
import numpy as np
from grainmotion.cli.interrupts import signals_end_the_command, stoppable
from grainmotion.io.files import atomic_write
matrix = np.random.default_rng(0).random((6000, 6000))
np.linalg.svd(matrix[:10, :10])
with signals_end_the_command(), stoppable(), atomic_write(sys.argv[1]):
    threading.Timer(0.2, lambda: os.kill(os.getpid(), signal.SIGINT)).start()
    print("begin", flush=True)
    np.linalg.svd(matrix)  # minutes in one call
    print("end", flush=True)
"""
"""A call of LAPACK that takes minutes and looks at no signal."""


def test_a_call_that_looks_at_no_signal_is_ended(tmp_path):
    done = subprocess.run([sys.executable, "-c", SLOW, str(tmp_path / "result.txt")], capture_output=True, text=True)
    assert (done.returncode, done.stdout, done.stderr) == (130, "begin\n", f"{INTERRUPTED}\n")
    assert not list(tmp_path.iterdir())
