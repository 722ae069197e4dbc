"""Image stacks specified as files, globs, lists, .npy, HDF5 datasets or NXtomo."""

import h5py
import numpy as np
import pytest
import tifffile

from grainmotion.errors import InputError
from grainmotion.io.stacks import find_stack

STACK = np.arange(12 * 4 * 5, dtype=np.uint16).reshape(12, 4, 5)


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "a[1]").mkdir()
    for k, image in enumerate(STACK):
        tifffile.imwrite(tmp_path / "a[1]" / f"proj_{k}.tif", image)
    tifffile.imwrite(tmp_path / "stack.TIFF", STACK)
    np.save(tmp_path / "stack.npy", STACK)
    np.save(tmp_path / "one.npy", STACK[3])
    with h5py.File(tmp_path / "data.h5", "w") as file:
        file["scan/images"] = STACK
        file["scan/four"] = np.zeros((2, 2, 2, 2))
    return tmp_path


@pytest.mark.parametrize("spec", ["stack.TIFF", "stack.npy", "data.h5::/scan/images", "data.h5::scan/images"])
def test_stack_in_one_file(folder, spec):
    stack = find_stack(spec, folder)
    assert stack.info() == (STACK.shape, np.dtype(np.uint16))
    np.testing.assert_array_equal(stack.read(), STACK)
    assert stack.read().dtype == np.uint16


def test_glob_sorts_by_number(folder):
    np.testing.assert_array_equal(find_stack("proj_*.tif", folder / "a[1]").read(), STACK)


def test_list_keeps_its_order(folder):
    images = find_stack(["one.npy", "stack.TIFF", "one.npy"], folder).read()
    np.testing.assert_array_equal(images, np.concatenate([STACK[3:4], STACK, STACK[3:4]]))


@pytest.mark.parametrize("spec", ["stack.TIFF", "stack.npy", "data.h5::scan/images", ["one.npy", "stack.npy"]])
@pytest.mark.parametrize("indices", [[7, 0, 3], [2], [0, 0, 5, 5]])
def test_selected_images(folder, spec, indices):
    stack, indices = find_stack(spec, folder), np.array(indices)
    np.testing.assert_array_equal(stack.read(indices), stack.read()[indices])


def test_selected_images_of_a_folder(folder):
    stack = find_stack("proj_*.tif", folder / "a[1]")
    read = stack.read(np.array([2, 11]))
    np.testing.assert_array_equal(read, STACK[[2, 11]])


@pytest.mark.parametrize(
    ("spec", "fact"),
    [
        ("no-*.tif", "no file matches"),
        ("none.tif", "no such file"),
        ("stack.npy::/a", "dataset of an HDF5"),
        ("data.h5::/scan/image", "it holds /scan/four, /scan/images"),
        ("data.h5::/scan/four", "is no stack"),
        ("data.h5", "no NXtomo entry"),
        ("notes.txt", "'.txt' is unknown"),
        ([], "empty"),
        (["stack.npy", "small.npy"], r"\(2, 2\) pixels, but stack.npy has \(4, 5\)"),
        ("none.npy", "it holds no image"),
        ("complex.npy", "its pixels are complex128, no real numbers"),
    ],
)
def test_bad_specifications_are_refused(folder, spec, fact):
    (folder / "notes.txt").write_text("hello")
    np.save(folder / "small.npy", np.zeros((2, 2)))
    np.save(folder / "none.npy", np.zeros((0, 2, 2)))
    np.save(folder / "complex.npy", np.zeros((2, 2, 2), complex))
    with pytest.raises(InputError, match=fact):
        find_stack(spec, folder).info()


@pytest.mark.parametrize("name", ["stack.npy", "data.h5::/scan/images"])
@pytest.mark.parametrize("share", [0.0, 0.01, 0.5, 0.99])
def test_truncated_file_is_refused(folder, name, share):
    path = folder / name.split("::")[0]
    whole = path.read_bytes()
    path.write_bytes(whole[: int(len(whole) * share)])
    with pytest.raises(InputError, match=path.name):
        find_stack(name, folder).info()


def test_headers_of_all_files_are_read_once(folder, monkeypatch):
    opened = []
    of_file = tifffile.TiffFile.__init__

    def count(self, *args, **kwargs):
        opened.append(args)
        of_file(self, *args, **kwargs)

    monkeypatch.setattr(tifffile.TiffFile, "__init__", count)
    stack = find_stack("proj_*.tif", folder / "a[1]")
    assert [stack.info()[0] for _ in range(4)] == [STACK.shape] * 4
    stack.read(np.array([3, 1]))
    assert len(opened) == len(STACK) + 2  # two files more for the pixels


def test_another_file_called_npy_is_refused(tmp_path):
    (tmp_path / "scan.npy").write_text("[Acquisition]\nNumber Of Files=6\n")
    with pytest.raises(InputError, match=r"scan\.npy: no file of numpy\.save, whatever its name says"):
        find_stack("scan.npy", tmp_path).info()
