"""The version is written alike everywhere, and the list of public names is that of the code."""

import ast
import contextlib
import csv
import re
import zipfile
from datetime import date
from operator import attrgetter

import pytest
from release import check, public_api

import grainmotion as gm
from grainmotion.calibration.corrections import Correction

with (check.ROOT / "release" / "former_names.csv").open(encoding="utf-8") as file:
    FORMER = list(csv.DictReader(file))


def test_all_files_name_one_version():
    assert check.one_version().count(".") == 2


def test_another_version_is_named(tmp_path, monkeypatch):
    for name in ("pyproject.toml", "CHANGELOG.md"):
        (tmp_path / name).write_text((check.ROOT / name).read_text())
    (tmp_path / "CITATION.cff").write_text("cff-version: 1.2.0\nversion: 0.0.9\n")
    monkeypatch.setattr(check, "ROOT", tmp_path)
    with pytest.raises(check.ReleaseError, match=r"CITATION\.cff': '0\.0\.9'"):
        check.one_version()


def test_public_names_are_those_of_the_list():
    """A name, a parameter or a default has changed: run `python release/public_api.py` and tell it in the changelog."""
    assert public_api.lines() == public_api.LIST.read_text(encoding="utf-8").splitlines()


def test_a_file_too_many_or_too_few_in_the_wheel_is_named(tmp_path):
    wheel = tmp_path / "grainmotion.whl"
    with zipfile.ZipFile(wheel, "w") as archive:
        archive.writestr("grainmotion/__init__.py", "")
        archive.writestr("tests/test_model.py", "")
    with pytest.raises(
        check.ReleaseError, match=r"grainmotion/py\.typed.*not of the package \['tests/test_model\.py'\]"
    ):
        check.contents(wheel)


def test_pythons_of_the_classifiers_are_declared():
    assert check.declared_pythons()[0] == "3.11"


def written_wheel(path, description="# x", requires=()):
    head = "".join(f"Requires-Dist: {line}\n" for line in requires)
    with zipfile.ZipFile(path / "x.whl", "w") as archive:
        archive.writestr("x-1.dist-info/METADATA", f"Metadata-Version: 2.4\nName: x\n{head}\n{description}")
    return path / "x.whl"


def test_a_link_that_an_index_cannot_follow_is_named(tmp_path):
    good = "[site](https://example.org) [here](#part)\n```python\nx[0](1)\n```"
    check.description(check.metadata(written_wheel(tmp_path, good)))
    with pytest.raises(check.ReleaseError, match=r"docs/a\.md"):
        check.description(check.metadata(written_wheel(tmp_path, "[page](docs/a.md)")))
    with pytest.raises(check.ReleaseError, match="no description"):
        check.description(check.metadata(written_wheel(tmp_path, "")))


def test_requirements_of_the_tested_extras_are_given_one_by_one(tmp_path):
    """Given the wheel alone, the installer takes the newest of all that it needs."""
    lines = ("numpy>=2.0", "zarr>=3; extra == 'zarr'", "napari>=1; extra == 'viewer'")
    assert check.required(written_wheel(tmp_path, requires=lines)) == ["numpy>=2.0", "zarr>=3"]


def test_a_bound_that_is_not_installed_is_named():
    installed = {"numpy": "2.4.6", "dask": "2024.12.0", "typing-extensions": "4.50"}
    wanted = ["numpy>=1.26", "dask[distributed]>=2024.12", "typing_extensions>=4.5"]
    untested = check.untested_bounds(wanted, installed)
    assert untested == ["numpy>=1.26, installed is 2.4.6", "typing_extensions>=4.5, installed is 4.50"]


def test_former_names_are_listed():
    """A name that warns is missing from release/former_names.csv, or one that is listed does not warn any more."""
    found = set()
    for path in (check.ROOT / "src").rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Call) and getattr(node.func, "id", "") == "deprecated":
                found.add(node.args[0].value.split()[0].rpartition(".")[2])
            elif isinstance(node, ast.Call) and getattr(node.func, "id", "") == "renamed_arguments":
                found |= {keyword.arg for keyword in node.keywords}
            elif isinstance(node, ast.Assign) and getattr(node.targets[0], "id", "").startswith("_FORMER"):
                found |= {key.value for key in node.value.keys}
    assert found == {re.split(r"[.(]", row["former"].rstrip(")"))[-1] for row in FORMER}


def use(former):
    """Use a former name: a public name, a member of a record that needs no values for it, or an argument."""
    where, _, argument = former.rstrip(")").partition("(")
    owner, _, name = where.rpartition(".")
    with contextlib.suppress(Exception):  # other arguments and values are missing
        if argument:
            attrgetter(where)(gm)(**{argument: None})
        elif owner in ("", "simulate"):
            getattr(attrgetter(owner)(gm) if owner else gm, name)
        else:
            record = Correction if owner == "Correction" else attrgetter(owner)(gm)
            getattr(record.__new__(record), name)(None)


@pytest.mark.parametrize("row", FORMER, ids=[row["former"] for row in FORMER])
def test_former_names_work_with_a_warning(row):
    new = re.split(r"[.(]", row["present"].rstrip(")"))[-1]
    with pytest.warns(DeprecationWarning, match=rf"is now .*\b{new}\b"):
        use(row["former"])


def test_names_go_after_a_release_and_half_a_year():
    rows = [{"former": "Panel", "since": "0.2.0", "date": "2026-11-30"}]
    assert check.too_early({"Panel", "track"}, rows, "0.3.0", date(2027, 6, 1)) == ["track"]
    assert check.too_early({"Panel"}, rows, "0.3.0", date(2027, 3, 1)) == ["Panel"]
    assert check.too_early({"Panel"}, rows, "0.2.1", date(2027, 6, 1)) == ["Panel"]
    names = check.public_names(["grainmotion.track(a=1)", "grainmotion.PAPER: TrackSettings"])
    assert names == {"track", "PAPER"}
