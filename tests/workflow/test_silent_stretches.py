"""Seconds between two reports of progress, at sizes where a silent loop takes long."""

import time

import pytest
from typer.testing import CliRunner

from grainmotion.cli import progress as shown
from grainmotion.cli.app import app
from grainmotion.model import progress

MAX_SILENT_SECONDS = 5.0
"""CPU seconds of all threads together, so that a busy machine does not count."""


class Silence:
    """CPU seconds between reports, the longest with what was told before it."""

    def __init__(self):
        self.last, self.before, self.longest = time.process_time(), "start", (0.0, "")

    def broken(self, message=""):
        now = time.process_time()
        self.longest = max(self.longest, (now - self.last, self.before))
        self.last, self.before = now, message or self.before


@pytest.mark.slow
@pytest.mark.parametrize("case", ["small", "paper"])
def test_no_long_stretch_is_silent(tmp_path, monkeypatch, case):
    silence, step, told = Silence(), progress.Listener.__call__, shown.compilation_told

    def begin(listener, message, done, total):
        silence.broken(message)
        step(listener, message, done, total)

    def inside(listener, share):
        silence.broken(f"{listener.step[0]} ({listener.what})")

    def compilation(tell):
        return told(lambda: (silence.broken(), tell()))

    monkeypatch.setattr(progress.Listener, "__call__", begin)
    monkeypatch.setattr(progress.Listener, "inside", inside)
    monkeypatch.setattr(shown, "compilation_told", compilation)
    experiment = tmp_path / case / "experiment.toml"
    formats = [word for name in ("vtk", "tiff", "spam", "mechanics") for word in ("--format", name)]
    for words in (["simulate", experiment.parent, "--case", case], ["inspect", experiment], ["run", experiment],
                  ["export", experiment, *formats]):  # fmt: skip
        silence.last = time.process_time()
        result = CliRunner().invoke(app, [str(word) for word in words])
        assert result.exit_code in (0, 3), result.output
        assert silence.longest[0] < MAX_SILENT_SECONDS, f"{words[0]}: {silence.longest}"
    print(silence.longest)
