"""TIFF files: round trips, layouts of other writers, and refusal of damaged files."""

import numpy as np
import pytest
import tifffile

from grainmotion.errors import InputError
from grainmotion.io.tiff import read_tiff, tiff_info, write_tiff

STACK = np.random.default_rng(0).integers(0, 60_000, (5, 40, 30)).astype(np.uint16)


def write_pages(path):
    with tifffile.TiffWriter(path) as writer:
        for page in STACK:
            writer.write(page, contiguous=False, metadata=None)


WRITERS = {
    "stack": lambda p: tifffile.imwrite(p, STACK),
    "compressed": lambda p: tifffile.imwrite(p, STACK, compression="zlib"),
    "plain": lambda p: tifffile.imwrite(p, STACK, metadata=None),
    "imagej": lambda p: tifffile.imwrite(p, STACK, imagej=True),
    "bigtiff": lambda p: tifffile.imwrite(p, STACK, bigtiff=True),
    "big-endian": lambda p: tifffile.imwrite(p, STACK, byteorder=">"),
    "pages": write_pages,
}


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.int32, np.float32])
@pytest.mark.parametrize("shape", [(6, 5), (4, 6, 5)])
def test_exact_round_trip(tmp_path, dtype, shape):
    array = (np.arange(np.prod(shape)).reshape(shape) % 251).astype(dtype)
    write_tiff(tmp_path / "a.tif", array)
    back = read_tiff(tmp_path / "a.tif")
    assert back.dtype == dtype
    np.testing.assert_array_equal(back, array.reshape(-1, 6, 5))
    assert tiff_info(tmp_path / "a.tif") == (back.shape, np.dtype(dtype))
    assert [p.name for p in tmp_path.iterdir()] == ["a.tif"]


@pytest.mark.parametrize("writer", WRITERS)
def test_layouts_of_other_writers_are_read(tmp_path, writer):
    WRITERS[writer](tmp_path / "a.tif")
    assert tiff_info(tmp_path / "a.tif")[0] == STACK.shape
    np.testing.assert_array_equal(read_tiff(tmp_path / "a.tif"), STACK)


@pytest.mark.parametrize("writer", WRITERS)
@pytest.mark.parametrize("share", [0.0005, 0.02, 0.2, 0.3, 0.5, 0.7, 0.9, 0.97])
def test_truncated_file_is_refused(tmp_path, writer, share):
    path = tmp_path / "a.tif"
    WRITERS[writer](path)
    whole = path.read_bytes()
    path.write_bytes(whole[: int(len(whole) * share)])
    with pytest.raises(InputError, match=r"a\.tif"):
        read_tiff(path)


def test_files_that_are_no_tiff_are_refused(tmp_path):
    path = tmp_path / "a.tif"
    for content in (b"", b"II", b"not a TIFF file at all", b"II\x2a\x00\xff\xff\xff\xff"):
        path.write_bytes(content)
        with pytest.raises(InputError, match=r"a\.tif"):
            read_tiff(path)
    with pytest.raises(InputError, match="no such file"):
        read_tiff(tmp_path / "b.tif")
    with pytest.raises(InputError, match="folder"):
        read_tiff(tmp_path)


def test_colour_and_mixed_sizes_are_refused(tmp_path):
    tifffile.imwrite(tmp_path / "rgb.tif", np.arange(1800, dtype=np.uint8).reshape(20, 30, 3), photometric="rgb")
    with pytest.raises(InputError, match="colour"):
        read_tiff(tmp_path / "rgb.tif")
    with tifffile.TiffWriter(tmp_path / "mixed.tif") as writer:
        writer.write(np.zeros((20, 30), np.uint8))
        writer.write(np.zeros((10, 30), np.uint8))
    with pytest.raises(InputError, match="different kinds"):
        read_tiff(tmp_path / "mixed.tif")


@pytest.mark.filterwarnings("ignore::DeprecationWarning")
@pytest.mark.parametrize("views", [2, 3, 4, 5])
def test_three_or_four_views_are_not_read_as_colours(tmp_path, views):
    """tifffile's default turns an array of three or four images into colour planes."""
    tifffile.imwrite(tmp_path / "a.tif", STACK[:views])
    np.testing.assert_array_equal(read_tiff(tmp_path / "a.tif"), STACK[:views])


def test_interrupted_write_keeps_the_old_file(tmp_path, monkeypatch):
    path = tmp_path / "a.tif"
    write_tiff(path, STACK[0])

    def interrupted(*_args, **_options):
        raise KeyboardInterrupt

    monkeypatch.setattr(tifffile, "imwrite", interrupted)
    with pytest.raises(KeyboardInterrupt):
        write_tiff(path, STACK[1])
    np.testing.assert_array_equal(read_tiff(path)[0], STACK[0])
    assert [p.name for p in tmp_path.iterdir()] == ["a.tif"]
