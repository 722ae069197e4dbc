"""Names by which files are known to a run (`workflow.provenance`)."""

from pathlib import Path

from grainmotion.workflow import provenance


def test_a_relative_name_follows_the_working_folder(tmp_path, monkeypatch):
    for name in ("one", "two"):
        (tmp_path / name).mkdir()
        monkeypatch.chdir(tmp_path / name)
        assert provenance._name(Path("scan.tif")) == str((tmp_path / name).resolve() / "scan.tif")


def test_links_are_followed(tmp_path):
    (tmp_path / "data").mkdir()
    (tmp_path / "data" / "scan.tif").touch()
    (tmp_path / "folder").symlink_to(tmp_path / "data")
    (tmp_path / "file.tif").symlink_to(tmp_path / "data" / "scan.tif")
    for path in (tmp_path / "folder" / "scan.tif", tmp_path / "file.tif"):
        assert provenance._name(path) == str((tmp_path / "data" / "scan.tif").resolve())
