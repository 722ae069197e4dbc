"""Findings on the terminal, the options about them, and the exit codes that follow."""

import logging
import re
import shutil

import numpy as np
import pytest
from typer.testing import CliRunner

from grainmotion.cli.app import app
from grainmotion.cli.interrupts import Stop
from grainmotion.cli.progress import progress
from grainmotion.cli.terminal import MIN_WIDTH, Terminal, styled
from grainmotion.io.findings_json import write_findings
from grainmotion.io.tiff import read_tiff, write_tiff
from grainmotion.model.finding import Finding, Level
from grainmotion.model.motions import Motions
from tiny_experiment import VIEWS, sample, write_tiny

NOTE = Finding(Level.NOTE, "pixels", "reference", "3 pixels masked")
WARNING = Finding(Level.WARNING, "beam-level", "states.one", "the beam fell by half", "0.5", "give flats of that day")
ERROR = Finding(
    Level.ERROR, "reference-geometry", "reference.geometry", "angles negated", "0.4, 0.03", "give the other sign"
)
REFERENCE_TABLE = f"""
[reference.geometry]
beam = "cone"
source_to_axis = 50
source_to_detector = 200
pixel_size = 0.4
first_row = "bottom"
angles_deg = {[-360 / VIEWS * k for k in range(VIEWS)]}
"""
STAGE_COMMANDS = ("run", "reconstruct", "segment", "track", "report", "export")


def invoke(*args):
    return CliRunner().invoke(app, [str(a) for a in args])


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    path = write_tiny(tmp_path_factory.mktemp("findings") / "tiny")
    assert invoke("run", path).exit_code == 0
    return path


@pytest.fixture
def copied(finished, tmp_path):
    shutil.copytree(finished.parent, tmp_path / "tiny")
    return tmp_path / "tiny" / "experiment.toml"


def plant(path, *found):
    """Let the check of an earlier run have found this."""
    write_findings(path.parent / "results" / "checks.json", found)
    return path


class TestTerminal:
    def test_each_finding_as_it_comes_and_again_at_the_end_worst_first(self, copied):
        path = plant(copied, NOTE, WARNING)
        result = invoke("run", path)
        as_they_come, lines = result.stderr.splitlines(), result.stdout.splitlines()
        note, warning = NOTE.line, WARNING.line
        assert as_they_come.count(note) == as_they_come.count(warning) == lines.count(note) == lines.count(warning) == 1
        assert as_they_come.index(note) < as_they_come.index(warning)
        report = f"report: {path.parent / 'results' / 'report.html'}"
        assert lines[lines.index(warning) :][:3] == [warning, note, report]

    def test_quiet_shows_warnings_but_no_notes(self, copied):
        path = plant(copied, NOTE, WARNING)
        text = invoke("run", path, "--quiet").stdout
        assert f"warning: {WARNING}" in text
        assert "note:" not in text

    @pytest.mark.parametrize("command", STAGE_COMMANDS)
    def test_every_command_that_runs_stages_shows_them(self, copied, command):
        path = plant(copied, WARNING)
        options = ["--format", "vtk"] if command == "export" else []
        assert f"warning: {WARNING}" in invoke(command, path, *options).stdout

    def test_lines_on_a_terminal_are_wrapped_with_the_level_in_colour(self):
        text = styled(
            f"warning: {WARNING}, or those before it", 40
        )  # narrower than any terminal that lines are wrapped for
        assert max(map(len, text.plain.splitlines())) < MIN_WIDTH
        assert text.plain.splitlines()[1].startswith("  ")
        assert text.plain[text.spans[0].start : text.spans[0].end] == "warning:"

    def test_bar_stays_below_the_findings(self, capsys, monkeypatch):
        monkeypatch.setattr("sys.stderr.isatty", lambda: True)
        monkeypatch.setenv("TERM", "xterm")
        with progress(Terminal(), Stop()) as listen:
            listen("step", 1, 2)
            logging.getLogger("grainmotion").warning("warning: %s", WARNING)
            listen("step", 2, 2)
        out, err = capsys.readouterr()
        assert out == ""
        plain = re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", err)
        assert f"warning: {WARNING}" in plain.replace("\n  ", " ")

    def test_listener_is_gone_afterwards(self):
        logger = logging.getLogger("grainmotion")
        before = list(logger.handlers), logger.level
        with progress(Terminal(), Stop()):
            assert len(logger.handlers) == len(before[0]) + 1
        assert (logger.handlers, logger.level) == before


class TestInspect:
    def test_findings_of_inspect_are_findings_of_a_run(self, copied):
        flats = read_tiff(copied.parent / "flats.tif")
        write_tiff(copied.parent / "flats.tif", (flats * 0.9).astype(np.uint16))
        line = "note: reference: the outermost columns have a line integral of -0.1"
        assert line in invoke("inspect", copied).stdout
        assert line in invoke("reconstruct", copied).stdout

    def test_flats_of_another_exposure_are_told_as_a_run_would_mend_them(self, copied):
        """The level of the beam is taken off before the geometry is judged."""
        flats = read_tiff(copied.parent / "flats.tif")
        write_tiff(copied.parent / "flats.tif", (flats * 0.6).astype(np.uint16))
        inspected = invoke("inspect", copied)
        assert inspected.exit_code == 0
        assert "warning: reference: the beam is brighter in all views than in the flats" in inspected.stdout
        assert "[reference-geometry]" not in inspected.stdout

    def test_an_error_that_would_stop_a_run(self, copied):
        text = copied.read_text().replace('geometry = "reference.csv"', REFERENCE_TABLE, 1)
        copied.write_text(text)
        inspected = invoke("inspect", copied)
        assert inspected.exit_code == 2
        assert "the sample is mirrored" in inspected.stdout
        assert invoke("reconstruct", copied).exit_code == 2

    def test_a_given_volume_is_compared_with_the_first_state(self, copied):
        write_tiff(copied.parent / "volume.tif", sample().array[::-1].astype(np.float32))
        text = copied.read_text()
        head, tail = text.index("[reference]"), text.index("[volume]")
        given = text[:head] + '[reference]\nvolume = "volume.tif"\n' + text[tail:]
        copied.write_text(given.replace("[[states]]", '[[states]]\nflats = "flats.tif"\ndarks = "darks.tif"'))
        inspected = invoke("inspect", copied)
        assert "[given-volume]" in inspected.stdout
        assert inspected.exit_code == 2

    def test_strict(self, copied):
        assert invoke("inspect", copied, "--strict").exit_code == 0
        copied.write_text(copied.read_text().split("[[states]]")[0])
        assert invoke("inspect", copied).exit_code == 0
        assert invoke("inspect", copied, "--strict").exit_code == 3


class TestExitCodes:
    def test_error_stops_with_2_and_names_force(self, copied):
        path = plant(copied, WARNING, ERROR)
        result = invoke("run", path)
        assert result.exit_code == 2
        log = path.parent / "results" / "run.log"
        last = result.stderr.splitlines()[-1]
        assert last == f"error: {ERROR}; or go on with --force [{ERROR.check}] (log: {log})"
        assert "end: error" in log.read_text().splitlines()[-1]
        assert f"warning: {WARNING}" in result.stderr

    def test_force_goes_on_and_shows_the_error(self, copied):
        path = plant(copied, ERROR)
        result = invoke("run", path, "--force")
        assert result.exit_code == 0
        assert f"error: {ERROR}" in result.stdout

    @pytest.mark.parametrize(("level", "code"), [(Level.NOTE, 0), (Level.WARNING, 3)])
    def test_strict_ends_with_3_after_a_warning(self, copied, level, code):
        path = plant(copied, Finding(level, "inspect", "reference", "something"))
        assert invoke("run", path).exit_code == 0
        result = invoke("run", path, "--strict")
        assert result.exit_code == code
        assert ("--strict is given" in result.stderr) is (code == 3)

    def test_state_without_usable_grain_ends_with_3(self, copied, monkeypatch):
        def nothing(grains, *_, **__):
            return Motions.identity(grains.labels, grains.centers), None

        monkeypatch.setattr("grainmotion.workflow.tracking_stage.track_with_residual", nothing)
        shutil.rmtree(copied.parent / "results" / "two")
        for command in ("track", "run"):
            result = invoke(command, copied)
            assert result.exit_code == 3
            assert result.stderr.splitlines()[-1] == "exit code 3: no grain of two is usable"

    def test_poorly_determined_grains_are_usable(self, finished):
        assert invoke("run", finished).exit_code == 0  # the grains are balls

    def test_help_lists_the_exit_codes(self):
        for command in ((), *((c,) for c in STAGE_COMMANDS)):
            assert "Exit codes" in invoke(*command, "--help").stdout
