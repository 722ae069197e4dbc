"""Ctrl-C and SIGTERM end a command cleanly at any moment, its first ones too."""

import json
import signal
import subprocess
import sys

import pytest

from grainmotion.cli import interrupts
from grainmotion.cli.failures import failure
from grainmotion.cli.json_output import document_text
from tiny_experiment import write_tiny

STOPPED = """
import os, signal, sys
class Stopping:
    def find_spec(self, name, path=None, target=None):
        if name == "{module}":
            sys.meta_path.remove(self)
            try:
                os.kill(os.getpid(), signal.{signal})
            except KeyboardInterrupt:
                if {lost}:
                    raise ImportError("something half imported") from None
                raise
sys.meta_path.insert(0, Stopping())
sys.argv = ["grainmotion", *{words}]
from grainmotion.__main__ import main
main()
"""
"""A command that a signal reaches while it imports a module; a library may make another error of the interrupt."""


@pytest.mark.parametrize(("name", "code"), [("SIGINT", 130), ("SIGTERM", 143)])
@pytest.mark.parametrize("lost", [False, True])
@pytest.mark.parametrize("module", ["grainmotion.cli.app", "typer", "grainmotion.experiment.config", "numba"])
def test_in_the_first_seconds(tmp_path, module, lost, name, code):
    words = ["watch", str(write_tiny(tmp_path))]
    program = STOPPED.format(module=module, signal=name, lost=lost, words=words)
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (code, f"{interrupts.INTERRUPTED}\n")
    assert not (tmp_path / "results").exists()


def test_handlers_are_given_back():
    before = signal.getsignal(signal.SIGTERM)
    with interrupts.stoppable() as stop, pytest.raises(KeyboardInterrupt):
        signal.raise_signal(signal.SIGTERM)
    assert stop.code == 143
    with pytest.raises(KeyboardInterrupt):
        stop.check()
    assert signal.getsignal(signal.SIGTERM) is before


def test_json_in_the_first_seconds(tmp_path):
    words = ["run", str(write_tiny(tmp_path)), "--json"]
    program = STOPPED.format(module="typer", signal="SIGTERM", lost=False, words=words)
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert done.returncode == 143
    assert json.loads(done.stdout) == interrupts.interrupted_document(143)
    failed = failure(KeyboardInterrupt(), interrupts.Stop())
    later = json.loads(document_text("grainmotion", None, (), (143, failed.fact), failed))
    assert later == interrupts.interrupted_document(143)


def test_an_outcome_that_is_being_printed_stays_whole():
    with interrupts.stoppable() as stop:
        stop.is_late()
        signal.raise_signal(signal.SIGINT)
        stop.check()


ENDED = """
import os, signal, sys
from grainmotion.cli.interrupts import signals_end_the_command
try:
    with signals_end_the_command():
        print("the outcome")
        sys.exit(3)
finally:
    os.kill(os.getpid(), signal.SIGINT)
"""


def test_a_signal_after_the_end_changes_nothing():
    done = subprocess.run([sys.executable, "-c", ENDED], capture_output=True, text=True)
    assert (done.returncode, done.stdout, done.stderr) == (3, "the outcome\n", "")
