"""The version is written alike everywhere, and the list of public names is that of the code."""

import zipfile

import pytest
from release import check, public_api


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
