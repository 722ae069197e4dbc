"""Files behind paths, patterns and folders, as they are called on other systems."""

import numpy as np
import pytest
import tifffile

from grainmotion.errors import InputError
from grainmotion.io.locate import locate


def images(folder, *names):
    folder.mkdir(parents=True, exist_ok=True)
    for name in names:
        tifffile.imwrite(folder / name, np.zeros((3, 4), np.uint16))


def names(located):
    return [path.name for path in located.files]


@pytest.mark.parametrize("folder", ["ref [1]", "Größe *", "试样 #1?", "a[b]c"])
def test_folders_with_characters_of_patterns(tmp_path, folder):
    images(tmp_path / folder, "p_10.tif", "p_9.tif")
    assert names(locate(f"{folder}/*.tif", tmp_path)) == ["p_9.tif", "p_10.tif"]
    assert names(locate(str(tmp_path / folder / "*.tif"), tmp_path / "elsewhere")) == ["p_9.tif", "p_10.tif"]


def test_pattern_in_a_folder_and_in_a_name(tmp_path):
    images(tmp_path / "part 1", "a.tif")
    images(tmp_path / "part 2", "b.tif", "proj[1].tif")
    assert names(locate("part */[ab].tif", tmp_path)) == ["a.tif", "b.tif"]
    assert names(locate("part 2/proj[1].tif", tmp_path)) == ["proj[1].tif"]


def test_case_is_ignored_where_nothing_else_matches_and_said(tmp_path):
    images(tmp_path, "p_1.TIF", "p_2.TIF")
    located = locate("*.tif", tmp_path)
    assert names(located) == ["p_1.TIF", "p_2.TIF"]
    assert "2 files that differ in case" in located.note
    images(tmp_path, "p_3.tif")
    assert names(locate("*.tif", tmp_path)) == ["p_3.tif"]


def test_hidden_files_are_left_out(tmp_path):
    images(tmp_path, "p_1.tif", "._p_1.tif")
    assert names(locate("*.tif", tmp_path)) == names(locate(".", tmp_path)) == ["p_1.tif"]


@pytest.mark.parametrize("name", ["scan", "scan/"])
def test_folder_gives_its_images(tmp_path, name):
    images(tmp_path / "scan", "p_10.tif", "p_9.TIFF")
    (tmp_path / "scan" / "notes.txt").write_text("hello")
    located = locate(name, tmp_path)
    assert names(located) == ["p_9.TIFF", "p_10.tif"]
    assert located.series


def test_folder_of_several_formats_is_refused(tmp_path):
    images(tmp_path / "scan", "p_1.tif", "p_2.tif")
    np.save(tmp_path / "scan" / "a.npy", np.zeros(3))
    with pytest.raises(InputError, match=r"several formats: 1 \.npy, 2 \.tif"):
        locate("scan", tmp_path)


def test_folder_without_images_is_refused(tmp_path):
    (tmp_path / "scan").mkdir()
    with pytest.raises(InputError, match="folder is empty"):
        locate("scan", tmp_path)
    (tmp_path / "scan" / "a.jpg").write_bytes(b"x")
    with pytest.raises(InputError, match=r"no image that can be read: 1 \.jpg; export the radiographs again"):
        locate("scan", tmp_path)


def test_home_folder(tmp_path, monkeypatch):
    images(tmp_path / "scan", "a.tif")
    monkeypatch.setenv("HOME", str(tmp_path))
    assert names(locate("~/scan/*.tif", tmp_path / "elsewhere")) == ["a.tif"]


def test_backslashes_are_named(tmp_path):
    images(tmp_path / "scan", "a.tif")
    with pytest.raises(InputError, match="write / instead of"):
        locate("scan\\*.tif", tmp_path)


def test_errors_tell_what_there_is(tmp_path):
    images(tmp_path / "scan", "stack.tif", "b.tiff", "c.tiff")
    with pytest.raises(InputError, match=r"no file matches, and the folder holds 2 \*\.tiff, 1 \*\.tif"):
        locate("scan/p_*.tif", tmp_path)
    with pytest.raises(InputError, match="there is no folder"):
        locate("scam/*.tif", tmp_path)
    with pytest.raises(InputError, match=r"no such file; did you mean 'stack\.tif'\?"):
        locate("scan/stak.tif", tmp_path)
