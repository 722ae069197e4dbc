"""`inspect` on the files of a results folder."""

import json
from pathlib import Path

import h5py
import pytest

from grainmotion.errors import InputError
from grainmotion.experiment.file_contents import describe_file
from grainmotion.experiment.result_contents import describe_results


@pytest.fixture
def results(tmp_path):
    """A results folder with a file of each sort; what is in them is not looked at."""
    (tmp_path / "stages.json").write_text(json.dumps({"grainmotion": "0.1.0"}))
    for name in ("report.html", "dem/poses.csv", "dem/stl/grain_00001.stl", "a b/grains.vtp", "a b/notes.doc"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text("x")
    with h5py.File(tmp_path / "series.h5", "w") as file:
        file["covariances"] = [0.0]
    return tmp_path


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("report.html", "the report on all states"),
        ("series.h5", "motions of all states"),
        ("dem/stl/grain_00001.stl", "surface of a grain, mm"),
        ("a b/grains.vtp", "grains as points for ParaView"),
    ],
)
def test_a_file_of_any_format_tells_what_it_is(results, name, content):
    assert content in dict(describe_file(results / name))["Result of a run"]


def test_columns_are_told_by_their_units(results, monkeypatch):
    monkeypatch.chdir(results.parent)
    lines = dict(describe_file(Path(results.name) / "dem" / "poses.csv"))  # a relative path
    assert lines["In mm"].startswith("x, y, z")
    assert "rx, ry, rz" in lines["In deg"]
    assert "docs/dem.md" in lines["Note"]


def test_other_files_and_files_elsewhere_are_no_results(results, tmp_path_factory):
    elsewhere = tmp_path_factory.mktemp("elsewhere") / "report.html"
    elsewhere.write_text("x")
    for path in (results / "a b" / "notes.doc", elsewhere):
        with pytest.raises(InputError, match="is unknown"):
            describe_file(path)


def test_the_folder_is_told_file_by_file(results):
    lines = dict(describe_results(results))
    assert lines["series.h5"] == "load series: motions of all states"
    assert lines["STATE/grains.vtp"].endswith("(1 state)")
    assert list(dict(describe_results(results / "a b"))) == ["grains.vtp"]
    assert list(dict(describe_results(results / "dem"))) == ["poses.csv", "stl"]
