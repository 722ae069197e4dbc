"""Writing onto a full disk: one error that names the file, whatever library was writing; an older file stays."""

import errno

import pytest

from grainmotion.errors import WriteError
from grainmotion.io.files import atomic_folder, atomic_write

FULL = (
    OSError(errno.ENOSPC, "No space left on device"),
    OSError(errno.ENOSPC, "Can't synchronously write data (file write failed: \n errno = 28)"),  # HDF5
    OSError("90000 requested and 1502 written"),  # tifffile
)


def fail(write, path, error):
    """Write a little, then meet an error."""
    with write(path) as temporary:
        (temporary / "a.csv" if temporary.is_dir() else temporary).write_text("newer")
        raise error


@pytest.mark.parametrize("error", FULL)
@pytest.mark.parametrize("write", [atomic_write, atomic_folder])
def test_a_full_disk_is_told_in_one_line(tmp_path, write, error):
    with pytest.raises(WriteError, match=r"series.h5: cannot be written: no space left on the disk; make room"):
        fail(write, tmp_path / "series.h5", error)
    assert list(tmp_path.iterdir()) == []


def test_an_older_file_stays(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text("older")
    with pytest.raises(WriteError):
        fail(atomic_write, path, FULL[0])
    assert path.read_text() == "older"


def test_an_error_about_another_file_is_not_taken_for_one_of_writing(tmp_path):
    with pytest.raises(FileNotFoundError), atomic_write(tmp_path / "a.csv"):
        (tmp_path / "missing.tif").read_bytes()
