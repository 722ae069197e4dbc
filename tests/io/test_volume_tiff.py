"""TIFF volumes: voxel size as other programs read it."""

from __future__ import annotations

import xml.etree.ElementTree as ET

import numpy as np
import pytest
import tifffile

from grainmotion.errors import InputError
from grainmotion.io.tiff import read_tiff
from grainmotion.io.volumes.tiff_writer import write_volume_tiff

SHAPE = (5, 4, 3)


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.float32])
def test_imagej_reads_voxel_size_and_axes(tmp_path, dtype):
    array = np.arange(60).reshape(SHAPE).astype(dtype)
    write_volume_tiff(tmp_path / "a.tif", array, 0.0105, center=(0.5, -1.0, 2.0))
    with tifffile.TiffFile(tmp_path / "a.tif") as file:
        assert file.is_imagej
        assert file.series[0].axes == "ZYX"
        told, page = file.imagej_metadata, file.pages[0]
        assert told["slices"] == 5
        assert told["spacing"] == pytest.approx(0.0105)
        assert told["unit"] == "mm"
        for name in ("XResolution", "YResolution"):
            pixels, mm = page.tags[name].value
            assert mm / pixels == pytest.approx(0.0105, rel=1e-6)
        assert "center = 0.5 -1.0 2.0 mm" in told["Info"]
    np.testing.assert_array_equal(read_tiff(tmp_path / "a.tif"), array)


@pytest.mark.parametrize("ome", [False, True])
def test_what_imagej_cannot_hold_is_ome(tmp_path, ome):
    array = np.arange(60).reshape(SHAPE).astype(np.int64) * (1 if ome else 2000)
    write_volume_tiff(tmp_path / "a.tif", array, 0.0105, ome=ome)
    with tifffile.TiffFile(tmp_path / "a.tif") as file:
        assert file.is_ome
        assert file.series[0].axes == "ZYX"
        pixels = ET.fromstring(file.ome_metadata).find(".//{*}Pixels")
        for axis in "XYZ":
            assert float(pixels.get(f"PhysicalSize{axis}")) == 0.0105
            assert pixels.get(f"PhysicalSize{axis}Unit") == "mm"
    assert tifffile.imread(tmp_path / "a.tif").dtype == (np.uint16 if ome else np.int32)
    np.testing.assert_array_equal(read_tiff(tmp_path / "a.tif"), array)


def test_negative_and_huge_numbers(tmp_path):
    array = np.arange(60).reshape(SHAPE) - 3
    write_volume_tiff(tmp_path / "a.tif", array, 0.1)
    np.testing.assert_array_equal(tifffile.imread(tmp_path / "a.tif"), array)
    with pytest.raises(InputError, match="from 0 to 2534030704640"):
        write_volume_tiff(tmp_path / "b.tif", np.where(array == 0, 2534030704640, 0), 0.1)
    assert not (tmp_path / "b.tif").exists()


def test_a_single_slice_and_an_image(tmp_path):
    write_volume_tiff(tmp_path / "a.tif", np.ones((1, 4, 3), np.float32), 0.1)
    assert read_tiff(tmp_path / "a.tif").shape == (1, 4, 3)
    with pytest.raises(InputError, match="no volume"):
        write_volume_tiff(tmp_path / "b.tif", np.ones((4, 3), np.float32), 0.1)
