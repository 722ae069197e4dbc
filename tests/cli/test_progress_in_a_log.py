"""Progress where there is no terminal: a line a step, life in long ones, silence with --quiet; compilation is told."""

import subprocess
import sys

import pytest

from grainmotion.cli import progress as shown
from grainmotion.cli.compiling import COMPILING
from grainmotion.cli.interrupts import Stop
from grainmotion.cli.progress import progress
from grainmotion.cli.terminal import Terminal
from grainmotion.model.progress import counted, detail


class Clock:
    """Seconds that pass as the test says."""

    def __init__(self):
        self.now = 0.0

    def monotonic(self):
        return self.now


@pytest.fixture
def clock(monkeypatch):
    clock = Clock()
    monkeypatch.setattr("time.monotonic", clock.monotonic)
    return clock


def test_a_long_step_has_a_line_now_and_then(clock, capsys):
    with progress(Terminal(), Stop()) as listen:
        listen("reading the scan", 0, 1)
        for _ in counted(range(10)):
            clock.now += 0.4 * shown.LOG_SECONDS
        listen("the next step", 0, 1)
    lines = capsys.readouterr().err.splitlines()
    assert lines[0].startswith("reading the scan ... 30%")
    assert len(lines) == 5
    assert lines[-2:] == ["reading the scan", "the next step"]


def test_parts_of_a_step_are_no_lines(clock, capsys):
    with progress(Terminal(), Stop()) as listen:
        listen("report", 0, 1)
        for k in range(3):
            detail("radiographs", k, 3)
            clock.now += 1
    assert capsys.readouterr().err == "report\n"


def test_quiet_is_silent(clock, capsys):
    with progress(Terminal(quiet=True), Stop()) as listen:
        listen("step", 0, 1)
        for _ in counted(range(3)):
            clock.now += 100
    assert capsys.readouterr().err == ""


COMPILED = """
import numba, sys
from grainmotion.cli.interrupts import Stop
from grainmotion.cli.progress import progress
from grainmotion.cli.terminal import Terminal
with progress(Terminal(quiet={quiet}), Stop()) as listen:
    listen("step", 0, 1)
    for _ in range(2):
        numba.njit(lambda x: x + 1)(1)
"""


@pytest.mark.parametrize("quiet", [False, True])
def test_compilation_says_what_it_is_once(quiet):
    program = COMPILED.format(quiet=quiet)
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stderr.splitlines() == ([] if quiet else [COMPILING, "step"])
