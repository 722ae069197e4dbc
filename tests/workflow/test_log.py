"""The log of runs: what an entry holds, when it is begun, and that it never ends a run."""

import logging
import re
import tomllib

import pytest

from grainmotion import __version__
from grainmotion.errors import InputError
from grainmotion.experiment.config import ExperimentFile, read_experiment
from grainmotion.model.finding import Finding, Level
from grainmotion.workflow import log
from grainmotion.workflow import run as workflow
from tiny_experiment import TOML, write_tiny

WARNING = Finding(Level.WARNING, "beam-level", "reference", "the beam fell by half")


@pytest.fixture
def path(tmp_path, monkeypatch):
    """The tiny experiment, with a reconstruction that takes no time, and a warning of the check of the reference."""
    monkeypatch.setattr("grainmotion.workflow.checks._reference_findings", lambda *_: (WARNING,))
    return write_tiny(tmp_path)


def run(path, until="segment"):
    workflow.run(read_experiment(path), until=until)
    return (path.parent / "results" / "run.log").read_text()


class TestEntry:
    def test_head(self, path):
        text = run(path)
        for words in (
            f"grainmotion {__version__}", "command: ", "call: run until segment", f"experiment: {path}",
            "Python 3.", "numpy ", " cores", "reference.radiographs: reference/*.tif, 40 files", "states.two: 3 views",
            "reference: 40 views of 28 x 36 pixels, counts",
        ):  # fmt: skip
            assert words in text

    def test_settings_are_those_of_the_file(self, path):
        experiment = read_experiment(path)
        lines = log.toml_lines(log.changed_settings(experiment))
        assert ExperimentFile.model_validate(tomllib.loads("\n".join(lines))) == experiment.tables
        assert 'first_row = "bottom"' in run(path)

    def test_stages_findings_and_end(self, path):
        lines = run(path).splitlines()
        tail = [line[20:] for line in lines if re.match(r"\d{4}-\d\d-\d\d \d\d:\d\d:\d\d ", line)]
        assert tail[0] == WARNING.line
        assert re.fullmatch(r"done: reconstruct, [0-9.]+ s, [0-9.]+ s of CPU in this process", tail[1])
        assert tail[-1].startswith("end: success, ")

    def test_entries_are_appended(self, path):
        run(path)
        text = run(path)
        assert text.count("====\n") == 2
        assert "kept: reconstruct" in text
        assert text.count(str(WARNING)) == 2


class TestFailures:
    def test_nothing_is_written_if_an_input_cannot_be_used(self, path):
        (path.parent / "flats.tif").write_bytes(b"")
        with pytest.raises(InputError):
            run(path)
        assert not (path.parent / "results").exists()

    @pytest.mark.parametrize(
        ("error", "end"),
        [
            (InputError("a", "b", "c"), "end: error, "),
            (KeyboardInterrupt(), "end: interrupted, "),
            (ZeroDivisionError(), "end: fault of the program, "),
        ],
    )
    def test_end_of_a_run_that_fails(self, path, monkeypatch, error, end):
        def fail(*_, **__):
            raise error

        monkeypatch.setattr("grainmotion.workflow.reference_stages.reconstruct", fail)
        with pytest.raises(type(error)):
            run(path)
        text = (path.parent / "results" / "run.log").read_text()
        assert end in text
        assert ("Traceback" in text) is isinstance(error, ZeroDivisionError)
        assert ("a: b; c" in text) is isinstance(error, InputError)

    def test_log_that_cannot_be_written_is_left_out(self, path):
        (path.parent / "results" / "run.log").mkdir(parents=True)
        workflow.run(read_experiment(path), until="reconstruct")
        assert (path.parent / "results" / "reconstruction.h5").exists()

    def test_handlers_are_gone_afterwards(self, path):
        logger = logging.getLogger("grainmotion")
        before = list(logger.handlers), logger.level
        run(path)
        assert (logger.handlers, logger.level) == before

    def test_warnings_reach_the_terminal_from_python_without_logging(self, path, capsys, monkeypatch):
        monkeypatch.setattr(logging.root, "handlers", [])
        run(path, until="reconstruct")
        assert f"warning: {WARNING}" in capsys.readouterr().err


def test_settings_at_their_defaults_are_left_out(path):
    assert "projector" not in "\n".join(log.toml_lines(log.changed_settings(read_experiment(path))))
    assert TOML.count("search = false") == 1
