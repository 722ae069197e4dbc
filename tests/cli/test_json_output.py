"""`--json`: one document on standard output, as docs/command-line.md tells, after errors too."""

import dataclasses
import json
import types
import typing

import numpy as np
import pytest
from typer.testing import CliRunner

from grainmotion.cli import documents
from grainmotion.cli.app import app
from grainmotion.io.tiff import read_tiff, write_tiff
from tiny_experiment import write_tiny


def document(*arguments, code=0, result=None):
    """The document of a command, checked against its declaration."""
    done = CliRunner().invoke(app, [*(str(a) for a in arguments), "--json"])
    assert done.exit_code == code, done.output
    told = json.loads(done.stdout)
    check(told, documents.Envelope)
    if result is not None:
        check(told["result"], result)
    assert told["exit_code"] == code
    return told


def check(value, declared):
    """A value is as its type declares it."""
    if typing.get_origin(declared) is typing.Annotated:
        declared = typing.get_args(declared)[0]
    origin, parts = typing.get_origin(declared), typing.get_args(declared)
    if origin is types.UnionType:
        kinds = [part for part in parts if part is not type(None)]
        assert value is not None or len(kinds) < len(parts)
        if value is not None and len(kinds) == 1:
            check(value, kinds[0])
    elif dataclasses.is_dataclass(declared):
        hints = typing.get_type_hints(declared, include_extras=True)
        assert list(value) == list(hints)
        for name, inner in value.items():
            check(inner, hints[name])
    elif origin in (list, tuple):
        for k, inner in enumerate(value):
            check(inner, parts[0] if origin is list else parts[k])
    elif origin is dict:
        for inner in value.values():
            check(inner, parts[1])
    else:
        assert isinstance(value, (int, float) if declared is float else declared), (value, declared)


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    return write_tiny(tmp_path_factory.mktemp("json") / "tiny")


def test_of_a_run(path):
    told = document("run", path, result=documents.RunOutcome)
    result = told["result"]
    assert told["command"] == "run"
    assert result["report"] == str(path.parent / "results" / "report.html")
    assert result["done"][:3] == ["reconstruct", "segment", "one/track"]
    one = result["states"][0]
    assert (one["name"], one["grains"], one["translations"]) == ("one", 3, 3)
    assert sum(one["statuses"].values()) == 3
    assert len(one["look_at"]) == 3 - one["converged"]
    assert str(path.parent / "results" / "one" / "motions.csv") in one["files"]
    assert str(path.parent / "results" / "reference.h5") in result["files"]
    again = document("export", path, "--format", "vtk", result=documents.RunOutcome)
    assert again["command"] == "export files"
    assert "one/track" in again["result"]["kept"]


def test_of_other_commands(path):
    inspected = document("inspect", path, result=documents.InspectOutcome)["result"]
    assert [scan["key"] for scan in inspected["scans"]] == ["reference", "states.one", "states.two"]
    assert inspected["volume_shape"] == [28, 36, 36]
    folder = document("inspect", path.parent, result=documents.InspectOutcome)["result"]
    assert {"key": "next", "text": f"grainmotion inspect {path}"} in folder["lines"]
    dry = document("run", path, "--dry-run", result=documents.DryRunOutcome)["result"]
    assert dry["stages"][0]["name"] == "reconstruct"
    version = document("version", result=documents.VersionOutcome)["result"]
    assert version["packages"]["numpy"] == np.__version__


def test_findings_and_errors(path, tmp_path):
    other = write_tiny(tmp_path)
    (tmp_path / "one.tif").unlink()
    told = document("run", other, code=2)
    assert told["error"]["kind"] == "input"
    assert "one.tif" in told["error"]["where"] + told["error"]["fact"]
    assert told["error"]["remedy"]
    assert told["result"] is None


def test_findings_that_came_before_an_error_are_told(tmp_path):
    path = write_tiny(tmp_path)
    flats = read_tiff(tmp_path / "flats.tif")
    write_tiff(tmp_path / "flats.tif", (flats * 0.6).astype(np.uint16))
    told = document("inspect", path)
    assert "beam-level" in [finding["check"] for finding in told["findings"]]


def test_a_fault_of_the_program(path, monkeypatch):
    """It names a file with the traceback, which is not printed."""

    def broken(*_, **__):
        raise RuntimeError("something that cannot be")

    monkeypatch.setattr("grainmotion.workflow.run.report_stage", broken)
    done = CliRunner().invoke(app, ["run", str(path), "--json"])
    told = json.loads(done.stdout)
    assert (done.exit_code, told["error"]["kind"]) == (1, "fault")
    assert "something that cannot be" in told["error"]["fact"]
    assert "report it" in told["error"]["remedy"]
    log = path.parent / "results" / "run.log"
    assert told["error"]["log"] == str(log)
    assert "Traceback" not in done.output
    assert "in broken" in log.read_text()


def test_a_fault_before_there_is_a_log(path, monkeypatch):
    def broken(*_, **__):
        raise RuntimeError("too early")

    monkeypatch.setattr("grainmotion.workflow.run.find_inputs", broken)
    done = CliRunner().invoke(app, ["run", str(path), "--json"])
    with open(json.loads(done.stdout)["error"]["log"]) as log:
        assert "too early" in log.read()
