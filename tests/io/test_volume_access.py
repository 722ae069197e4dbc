"""Volumes and labels written by this package: read back, and by other programs."""

from __future__ import annotations

import json
import tracemalloc

import h5py
import ngff_zarr
import numpy as np
import pytest
import tifffile
import zarr
from volume_writers import SHAPE, VOLUME, VOXEL, imagej, ome_zarr, plain_zarr

import grainmotion as gm
from grainmotion.errors import InputError
from grainmotion.io.volumes import zarr_writer
from grainmotion.model.volume import Volume

ARRAY = VOLUME.astype(np.float32) / 7
LABELS = np.where(VOLUME > 150, VOLUME.astype(np.int64) * 500, 0)  # up to 104,500: more than 16 bits hold
CENTER = (0.25, -1.0, 3.0)


@pytest.fixture
def volume():
    """A volume off the axis, no two axes alike."""
    return Volume(ARRAY, VOXEL, CENTER)


class TestRoundTrip:
    @pytest.mark.parametrize("name", ["a.tif", "a.h5", "a.zarr", "a.ome.zarr"])
    def test_volume_and_labels(self, tmp_path, volume, name):
        gm.write_volume(tmp_path / name, volume, labels=LABELS)
        back = gm.read_volume(tmp_path / name)
        np.testing.assert_array_equal(back.array, ARRAY)
        assert back.voxel_size == pytest.approx(VOXEL, rel=1e-8)
        assert back.center == CENTER
        inner = {"a.tif": "a_labels.tif", "a.h5": "a.h5::labels"}.get(name, f"{name}::labels/grains")
        np.testing.assert_array_equal(gm.read_labels(tmp_path / inner), LABELS)

    @pytest.mark.parametrize("name", ["a.tif", "a.ome.tif", "a.h5", "a.zarr"])
    def test_labels_alone(self, tmp_path, volume, name):
        gm.write_labels(tmp_path / name, LABELS, volume)
        np.testing.assert_array_equal(gm.read_labels(tmp_path / name), LABELS)
        grid = gm.read_volume(tmp_path / name)
        assert grid.voxel_size == pytest.approx(VOXEL)
        assert grid.center == CENTER

    @pytest.mark.parametrize("name", ["a.tif", "a.h5", "a.zarr"])
    def test_one_slice(self, tmp_path, name):
        slab = Volume(ARRAY[2:3], VOXEL, CENTER)
        gm.write_volume(tmp_path / name, slab, labels=LABELS[2:3])
        back = gm.read_volume(tmp_path / name)
        np.testing.assert_array_equal(back.array, ARRAY[2:3])
        assert back.center == CENTER

    def test_a_name_of_ome_tiff_is_one(self, tmp_path, volume):
        gm.write_volume(tmp_path / "a.ome.tif", volume, labels=LABELS.tolist())
        for name, expected in (("a.ome.tif", ARRAY), ("a_labels.ome.tif", LABELS)):
            with tifffile.TiffFile(tmp_path / name) as file:
                assert file.is_ome
                np.testing.assert_array_equal(file.asarray(), expected)

    def test_a_volume_that_was_cropped_in_fiji_has_lost_its_place(self, tmp_path, volume):
        gm.write_volume(tmp_path / "a.tif", volume)
        with tifffile.TiffFile(tmp_path / "a.tif") as file:
            told = file.imagej_metadata
        metadata = {"axes": "ZYX", "Info": told["Info"], "unit": "mm", "spacing": VOXEL}
        per_mm = (1 / VOXEL, 1 / VOXEL)
        tifffile.imwrite(tmp_path / "b.tif", ARRAY[1:], imagej=True, resolution=per_mm, metadata=metadata)
        assert gm.read_volume(tmp_path / "b.tif").center == (0, 0, 0)

    def test_what_is_told_comes_first(self, tmp_path, volume):
        gm.write_volume(tmp_path / "a.h5", volume)
        back = gm.read_volume(tmp_path / "a.h5", voxel_size=0.5, center=(1, 2, 3))
        assert (back.voxel_size, back.center) == (0.5, (1, 2, 3))

    def test_writing_again_replaces(self, tmp_path, volume):
        gm.write_volume(tmp_path / "a.zarr", volume, labels=LABELS)
        gm.write_volume(tmp_path / "a.zarr", Volume(ARRAY + 1, VOXEL))
        np.testing.assert_array_equal(gm.read_volume(tmp_path / "a.zarr").array, ARRAY + 1)
        assert [p.name for p in tmp_path.iterdir()] == ["a.zarr"]
        with pytest.raises(InputError, match="no level"):
            gm.read_labels(tmp_path / "a.zarr::labels/grains")


class TestOtherProgramsRead:
    def test_ome_zarr(self, tmp_path, volume):
        gm.write_volume(tmp_path / "a.zarr", volume, labels=LABELS)
        for place, expected in (("", ARRAY), ("labels/grains", LABELS)):
            image = ngff_zarr.from_ngff_zarr(str(tmp_path / "a.zarr" / place)).images[0]
            assert image.dims == ("z", "y", "x")
            np.testing.assert_array_equal(np.asarray(image.data), expected)
            assert image.scale == pytest.approx(dict.fromkeys("zyx", VOXEL))
            assert set(image.axes_units.values()) == {"millimeter"}
            assert [image.translation[a] for a in "xyz"] == pytest.approx(volume.origin)

    def test_hdf5(self, tmp_path, volume):
        gm.write_volume(tmp_path / "a.h5", volume, labels=LABELS)
        with h5py.File(tmp_path / "a.h5") as file:
            np.testing.assert_array_equal(file["volume"][()], ARRAY)
            np.testing.assert_allclose(file["labels"].attrs["element_size_um"], [1000 * VOXEL] * 3)
            assert file.attrs["grainmotion"] == gm.__version__
            assert file["volume"].attrs["unit"] == "1/mm"


class TestPyramid:
    def test_levels(self, tmp_path, monkeypatch):
        monkeypatch.setattr(zarr_writer, "CHUNK", 3)
        monkeypatch.setattr(zarr_writer, "MAX_COARSEST_VOXELS", 4)
        shape = (13, 8, 10)
        array = np.random.default_rng(1).random(shape).astype(np.float32)
        labels = np.arange(array.size).reshape(shape)
        gm.write_volume(tmp_path / "a.zarr", Volume(array, VOXEL, CENTER), labels=labels)
        group = zarr.open_group(str(tmp_path / "a.zarr"), mode="r")
        assert [group[k].shape for k in "012"] == [(13, 8, 10), (6, 4, 5), (3, 2, 2)]
        means = array[:12].reshape(6, 2, 4, 2, 5, 2).mean(axis=(1, 3, 5))
        np.testing.assert_allclose(group["1"][:], means, rtol=1e-6)
        np.testing.assert_allclose(
            group["2"][:], means[..., :4].reshape(3, 2, 2, 2, 2, 2).mean(axis=(1, 3, 5)), rtol=1e-5
        )
        np.testing.assert_array_equal(group["labels/grains/1"][:], labels[:12:2, ::2, ::2])
        assert group["0"].chunks == (3, 3, 3)
        origin = Volume(array, VOXEL, CENTER).origin[::-1]
        scales = group.attrs["multiscales"][0]["datasets"][2]["coordinateTransformations"]
        assert scales[0]["scale"] == pytest.approx([4 * VOXEL] * 3)
        np.testing.assert_allclose(scales[1]["translation"], origin + 1.5 * VOXEL)

    def test_memory_does_not_grow_with_the_number_of_planes(self, tmp_path):
        peaks = []
        for planes in (256, 1024):
            volume = Volume(np.ones((planes, 64, 64), np.float32), VOXEL)
            tracemalloc.start()
            gm.write_volume(tmp_path / "a.zarr", volume)
            peaks.append(tracemalloc.get_traced_memory()[1])
            tracemalloc.stop()
        assert peaks[1] < 1.3 * peaks[0]
        assert peaks[1] < volume.array.nbytes


class TestRefused:
    def test_names_and_shapes(self, tmp_path, volume):
        with pytest.raises(InputError, match=r"'\.mha' cannot be written; give a name that ends with"):
            gm.write_volume(tmp_path / "a.mha", volume)
        with pytest.raises(InputError, match="shape"):
            gm.write_volume(tmp_path / "a.tif", volume, labels=LABELS[1:])
        with pytest.raises(InputError, match="wants Volume"):
            gm.write_volume(tmp_path / "a.tif", ARRAY)

    def test_a_folder_of_something_else_stays(self, tmp_path, volume):
        (tmp_path / "a.zarr").mkdir()
        (tmp_path / "a.zarr" / "notes.txt").write_text("keep")
        with pytest.raises(InputError, match="something else has this name"):
            gm.write_volume(tmp_path / "a.zarr", volume)
        assert (tmp_path / "a.zarr" / "notes.txt").read_text() == "keep"

    def test_sizes_that_are_not_told(self, tmp_path):
        plain_zarr(tmp_path / "a.zarr")
        with pytest.raises(InputError, match="tells no voxel size; give voxel_size"):
            gm.read_volume(tmp_path / "a.zarr")
        imagej(tmp_path / "a.tif", "mm", 100.0, 0.02)
        with pytest.raises(InputError, match="no cubes"):
            gm.read_volume(tmp_path / "a.tif")

    def test_damaged_metadata(self, tmp_path):
        ome_zarr(tmp_path / "a.zarr")
        (tmp_path / "a.zarr" / ".zattrs").write_text(json.dumps({"multiscales": [{"datasets": [{"path": "7"}]}]}))
        with pytest.raises(InputError, match="level '7' is missing"):
            gm.read_volume(tmp_path / "a.zarr", voxel_size=1)
        (tmp_path / "a.zarr" / ".zattrs").write_text("{")
        with pytest.raises(InputError, match=r"a\.zarr"):
            gm.read_volume(tmp_path / "a.zarr", voxel_size=1)
        assert VOLUME.shape == SHAPE
