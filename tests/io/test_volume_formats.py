"""Volumes of other programs come back voxel by voxel, with their voxel size: a flip or another order of axes fails."""

from __future__ import annotations

import re

import h5py
import nibabel
import nrrd
import numpy as np
import pytest
import SimpleITK
import tifffile
import zarr
from volume_writers import (
    SHAPE,
    VOLUME,
    VOXEL,
    amira,
    blosc_of_noise,
    compressed_hdf5,
    gzipped,
    hdf5,
    ilastik,
    imagej,
    itk,
    nifti,
    nifti2,
    nrrd_file,
    ome_tiff,
    ome_zarr,
    ome_zarr_xyz,
    pages,
    plain_zarr,
    series,
    sharded,
    vgi,
)

from grainmotion.errors import InputError
from grainmotion.io.results import StoredReference, write_reference
from grainmotion.io.volumes import record
from grainmotion.io.volumes.find import find_volume
from grainmotion.model.volume import Volume

X, Y, Z = SHAPE[::-1]
SIZED = {
    "ImageJ": ("a.tif", imagej),
    "ImageJ, mm": ("a.tif", lambda p: imagej(p, "mm", 1 / VOXEL, VOXEL)),
    "ImageJ, µm in its own letters": ("a.tif", lambda p: imagej(p, "\\u00B5m")),
    "ImageJ, inch": ("a.tif", lambda p: imagej(p, "inch", 25.4 / VOXEL, VOXEL / 25.4)),
    "OME-TIFF": ("a.ome.tif", ome_tiff),
    "OME-TIFF, mm, BigTIFF": ("a.tif", lambda p: ome_tiff(p, "mm", VOXEL, bigtiff=True)),
    "OME-TIFF, compressed": ("a.tif", lambda p: ome_tiff(p, compression="zlib")),
    "TIFF with pixels a cm": ("a.tif", pages),
    "HDF5, element_size_um": ("a.h5", lambda p: hdf5(p, element_size_um=[12.5, 12.5, 12.5])),
    "HDF5, voxel_size": ("a.h5", lambda p: hdf5(p, voxel_size=12.5, voxel_size_unit="µm")),
    "HDF5, spacing": ("a.h5", lambda p: hdf5(p, spacing=[0.0125] * 3, spacing_units=b"mm")),
    "NIfTI": ("a.nii", nifti),
    "NIfTI, compressed, µm": ("a.nii.gz", lambda p: nifti(p, "micron", 12.5)),
    "NIfTI-2": ("a.nii", nifti2),
    "NIfTI of SimpleITK": ("a.nii.gz", itk),
    "MetaImage": ("a.mha", itk),
    "MetaImage, compressed": ("a.mha", lambda p: itk(p, True)),
    "MetaImage, detached": ("a.mhd", itk),
    "MetaImage, detached and compressed": ("a.mhd", lambda p: itk(p, True)),
    "NRRD of SimpleITK": ("a.nrrd", itk),
    "NRRD of SimpleITK, compressed": ("a.nrrd", lambda p: itk(p, True)),
    "NRRD": ("a.nrrd", nrrd_file),
    "NRRD, detached": ("a.nhdr", lambda p: nrrd_file(p, encoding="raw")),
    "AmiraMesh": ("a.am", amira),
    "AmiraMesh, big endian": ("a.am", lambda p: amira(p, order=">")),
    "AmiraMesh, zip": ("a.am", lambda p: amira(p, "HxZip")),
    "AmiraMesh labels": ("a.am", lambda p: amira(p, "HxByteRLE", kind="byte")),
    "AmiraMesh, float": ("a.am", lambda p: amira(p, kind="float")),
    "VGStudio": ("a.vgi", vgi),
    "VGStudio, µm": ("a.vgi", lambda p: vgi(p, "um", 12.5)),
    "OME-Zarr 0.4": ("a.zarr", ome_zarr),
    "OME-Zarr 0.5": ("a.ome.zarr", lambda p: ome_zarr(p, "0.5")),
    "OME-Zarr, one channel": ("a.zarr", lambda p: ome_zarr(p, "0.5", ("t", "c", "z", "y", "x"))),
    "OME-Zarr, axes x y z": ("a.zarr", ome_zarr_xyz),
}
UNSIZED = {
    ".npy": ("a.npy", lambda p: np.save(p, VOLUME)),
    ".npy, Fortran order": ("a.npy", lambda p: np.save(p, np.asfortranarray(VOLUME))),
    "TIFF": ("a.tif", lambda p: tifffile.imwrite(p, VOLUME)),
    "TIFF at 72 dpi": ("a.tif", lambda p: tifffile.imwrite(p, VOLUME, resolution=(72, 72), resolutionunit="INCH")),
    "ImageJ at 72 dpi": ("a.tif", lambda p: imagej(p, "inch", 72, 1)),
    "ImageJ in pixels": ("a.tif", lambda p: imagej(p, "pixel", 1, 1)),
    "TIFF series": ("a", series),
    "HDF5": ("a.h5", hdf5),
    "HDF5, size without unit": ("a.h5", lambda p: hdf5(p, voxel_size=12.5)),
    "HDF5 of ilastik": ("a.h5", ilastik),
    "NIfTI without a size": ("a.nii", lambda p: nifti(p, size=1.0)),
    "AmiraMesh without a unit": ("a.am", lambda p: amira(p, unit="")),
    "Zarr 2 array": ("a.zarr", plain_zarr),
    "Zarr 3 array": ("a", lambda p: plain_zarr(p, 3)),
    "raw by its name": ("a_5x6x7_uint16_le.raw", lambda p: VOLUME.astype("<u2").tofile(p)),
    "raw by its name, big endian": ("a-5x6x7-16bit-big.raw", lambda p: VOLUME.astype(">u2").tofile(p)),
}


MORE = {
    "BigTIFF": ("a.tif", lambda p: tifffile.imwrite(p, VOLUME, bigtiff=True, compression="zlib")),
    "TIFF in tiles": ("a.tif", lambda p: tifffile.imwrite(p, VOLUME, tile=(16, 16), compression="lzw")),
    "HDF5, compressed": ("a.h5", compressed_hdf5),
    "Zarr 3 in shards": ("a.zarr", sharded),
    "Zarr 2, Blosc of noise": ("a.zarr", blosc_of_noise),
}
"""Files that lose voxels where they are cut."""


@pytest.mark.parametrize("name", SIZED)
def test_voxels_and_their_size(tmp_path, name):
    file, write = SIZED[name]
    write(tmp_path / file)
    volume = find_volume(file, tmp_path)
    assert volume.shape == SHAPE
    assert volume.voxel is not None
    assert volume.voxel.size == pytest.approx(VOXEL, rel=1e-6)
    np.testing.assert_array_equal(volume.read(), VOLUME)


@pytest.mark.parametrize("axes", [(0,), (1,), (2,), (0, 1), (0, 2), (1, 2), (0, 1, 2)])
def test_any_flip_would_be_noticed(axes):
    """The test volume is unlike each of its mirror images, and its axes have different lengths."""
    assert (np.flip(VOLUME, axes) != VOLUME).any()
    assert len(set(SHAPE)) == 3


@pytest.mark.parametrize("name", UNSIZED)
def test_voxels_without_a_size(tmp_path, name):
    file, write = UNSIZED[name]
    write(tmp_path / file)
    volume = find_volume(file, tmp_path)
    assert volume.shape == SHAPE
    assert volume.voxel is None
    np.testing.assert_array_equal(volume.read(np.float32), VOLUME)


@pytest.mark.parametrize("name", [*SIZED, *UNSIZED])
def test_slabs(tmp_path, name, monkeypatch):
    """Read two planes at a time, and some planes alone."""
    monkeypatch.setattr(record, "SLAB_BYTES", 2 * X * Y * VOLUME.itemsize)
    file, write = (SIZED | UNSIZED)[name]
    write(tmp_path / file)
    volume = find_volume(file, tmp_path)
    assert len(volume.bounds) >= 2 or volume.depth == SHAPE[0]
    np.testing.assert_array_equal(volume.read(), VOLUME)
    np.testing.assert_array_equal(volume.read_slab(2, 4), VOLUME[2:4])


class TestRaw:
    @pytest.mark.parametrize("dtype", ["uint8", "int8", "<u2", "<i2", ">u2", ">f4", "<f4", "<i4", "<u4", "<f8"])
    def test_types(self, tmp_path, dtype):
        array = VOLUME.astype(dtype)
        (tmp_path / "a.vol").write_bytes(b"\x07" * 16 + array.tobytes())
        order = "big" if dtype.startswith(">") else "little"
        volume = find_volume(f"a.vol::{array.dtype.name},x=5,y=6,z=7,offset=16,{order}", tmp_path)
        assert volume.dtype == array.dtype
        np.testing.assert_array_equal(volume.read(), array)

    @pytest.mark.parametrize(
        ("text", "message"),
        [
            ("uint16,x=5,y=6,z=9", r"5 x 6 x 9 .* 540 bytes, but a\.raw has 420; z = 7 planes"),
            ("uint8,x=5,y=6,z=7", "uint16 of these sizes"),
            ("uint16,x=11,y=9,z=2", "a header of 24 bytes, offset=24"),
            ("uint16,x=11,y=11,z=11", "truncated"),
            ("uint16,5,6,7", "along which axis"),
            ("uint16,x=5,y=6", "lacks z"),
            ("x=5,y=6,z=7", "lacks one type"),
            ("uint17,x=5,y=6,z=7", "'uint17' is no type"),
            ("uint16,x=5,y=6,z=0", "hold no voxel"),
        ],
    )
    def test_sizes_that_do_not_fit(self, tmp_path, text, message):
        VOLUME.tofile(tmp_path / "a.raw")
        with pytest.raises(InputError, match=message):
            find_volume(f"a.raw::{text}", tmp_path)

    def test_no_sizes(self, tmp_path):
        VOLUME.tofile(tmp_path / "a.raw")
        with pytest.raises(InputError, match=r'give "a\.raw::uint16,x='):
            find_volume("a.raw", tmp_path)

    def test_a_header_beside_it_is_used(self, tmp_path):
        itk(tmp_path / "a.mhd")
        volume = find_volume("a.raw", tmp_path)
        assert "a.mhd" in volume.notes[0]
        assert volume.voxel.size == VOXEL

    def test_a_name_that_contradicts_its_bytes(self, tmp_path):
        VOLUME.tofile(tmp_path / "a_5x6x9_uint16.raw")
        with pytest.raises(InputError, match="z = 7 planes"):
            find_volume("a_5x6x9_uint16.raw", tmp_path)


class TestHdf5:
    def test_nxdata(self, tmp_path):
        with h5py.File(tmp_path / "a.h5", "w") as file:
            file["entry/data"] = VOLUME
            file["entry"].attrs["axes"] = ["z", "y", "x"]
            for axis, n in zip("zyx", SHAPE):
                file[f"entry/{axis}"] = np.arange(n) * 12.5
                file[f"entry/{axis}"].attrs["units"] = "um"
        assert find_volume("a.h5::entry/data", tmp_path).voxel.size == pytest.approx(VOXEL)

    def test_several_volumes(self, tmp_path):
        with h5py.File(tmp_path / "a.h5", "w") as file:
            file["one"] = file["two"] = VOLUME
        with pytest.raises(InputError, match=r'2 volumes: /one .* as "a\.h5::/one"'):
            find_volume("a.h5", tmp_path)

    def test_axes_by_name(self, tmp_path):
        with h5py.File(tmp_path / "a.h5", "w") as file:
            data = file.create_dataset("a", data=VOLUME.transpose(2, 1, 0))
            for dimension, label in zip(data.dims, "xyz"):
                dimension.label = label
        np.testing.assert_array_equal(find_volume("a.h5", tmp_path).read(), VOLUME)

    def test_reference_of_a_run(self, tmp_path):
        volume = Volume(VOLUME.astype(np.float32), VOXEL, (0.5, 1.0, -2.0))
        write_reference(tmp_path / "reference.h5", StoredReference(volume, labels=VOLUME.astype(np.int32)))
        for inner in ("", "::labels"):
            found = find_volume(f"reference.h5{inner}", tmp_path)
            assert (found.voxel.size, found.center) == (VOXEL, (0.5, 1.0, -2.0))
            np.testing.assert_array_equal(found.read(), VOLUME)


class TestZarr:
    def test_axes_by_the_names_of_xarray(self, tmp_path):
        array = zarr.create_array(str(tmp_path / "a.zarr"), shape=SHAPE[::-1], dtype="u2", zarr_format=2)
        array[:] = VOLUME.transpose(2, 1, 0)
        array.attrs["_ARRAY_DIMENSIONS"] = ["x", "y", "z"]
        np.testing.assert_array_equal(find_volume("a.zarr", tmp_path).read(), VOLUME)

    def test_another_level(self, tmp_path):
        ome_zarr(tmp_path / "a.zarr")
        volume = find_volume("a.zarr::1", tmp_path)
        assert volume.shape == (3, 3, 5)
        assert volume.voxel.size is None
        assert volume.voxel.edges == pytest.approx((VOXEL, 2 * VOXEL, 2 * VOXEL))
        with pytest.raises(InputError, match="no level '7'"):
            find_volume("a.zarr::7", tmp_path)

    def test_labels_within_an_image(self, tmp_path):
        ome_zarr(tmp_path / "a.zarr", "0.5")
        ome_zarr(tmp_path / "a.zarr" / "labels" / "grains", "0.5")
        np.testing.assert_array_equal(find_volume("a.zarr::labels/grains", tmp_path).read(), VOLUME)
        with pytest.raises(InputError, match="no level 'labels/grain'"):
            find_volume("a.zarr::labels/grain", tmp_path)

    def test_chunks_that_are_missing(self, tmp_path):
        plain_zarr(tmp_path / "a.zarr")
        chunks = sorted(p for p in (tmp_path / "a.zarr").iterdir() if p.name[0].isdigit())
        chunks[0].unlink()
        assert "1 of 36 chunks are not stored" in find_volume("a.zarr", tmp_path).notes[0]
        for chunk in chunks[1:]:
            chunk.unlink()
        with pytest.raises(InputError, match="none of its chunks"):
            find_volume("a.zarr", tmp_path)

    def test_a_damaged_chunk(self, tmp_path):
        plain_zarr(tmp_path / "a.zarr")
        chunk = next(p for p in (tmp_path / "a.zarr").iterdir() if p.name[0].isdigit())
        chunk.write_bytes(b"nothing")
        with pytest.raises(InputError, match="chunk cannot be read"):
            find_volume("a.zarr", tmp_path).read()

    def test_several_channels(self, tmp_path):
        zarr.create_array(str(tmp_path / "a.zarr"), shape=(2, *SHAPE), dtype="u2")[:] = 1
        with pytest.raises(InputError, match="no volume"):
            find_volume("a.zarr", tmp_path)

    def test_a_store_in_a_zip_file(self, tmp_path):
        store = zarr.storage.ZipStore(tmp_path / "a.zarr.zip", mode="w")
        zarr.create_array(store, shape=SHAPE, dtype="u2")[:] = VOLUME
        store.close()
        np.testing.assert_array_equal(find_volume("a.zarr.zip", tmp_path).read(), VOLUME)

    def test_zarr_is_not_installed(self, tmp_path, monkeypatch):
        plain_zarr(tmp_path / "a.zarr")
        monkeypatch.setitem(__import__("sys").modules, "zarr", None)
        with pytest.raises(InputError, match=r"pip install 'grainmotion\[zarr\]'"):
            find_volume("a.zarr", tmp_path)


class TestTiff:
    @pytest.mark.parametrize(
        ("axes", "shape"), [("CZYX", (2, 7, 6, 5)), ("TZYX", (2, 7, 6, 5)), ("ZCYX", (7, 2, 6, 5))]
    )
    def test_channels_and_times_are_refused(self, tmp_path, axes, shape):
        order = {"ZCYX": "ZCYX", "CZYX": "ZCYX", "TZYX": "TZYX"}[axes]
        sizes = dict(zip(axes, shape))
        array = np.ones([sizes[a] for a in order], np.uint16)
        tifffile.imwrite(tmp_path / "a.tif", array, imagej=True, metadata={"axes": order})
        tifffile.imwrite(tmp_path / "b.tif", np.ones(shape, np.uint16), ome=True, metadata={"axes": axes})
        for name in ("a.tif", "b.tif"):
            with pytest.raises(InputError, match="several volumes: "):
                find_volume(name, tmp_path)

    def test_colours_are_refused(self, tmp_path):
        """Colours of a pixel beside each other, or in planes; not even uncompressed ones are taken for grey."""
        colours = np.stack([VOLUME % 200, VOLUME % 190, VOLUME % 180], axis=-1).astype(np.uint8)
        tifffile.imwrite(tmp_path / "a.tif", colours, photometric="rgb")
        with pytest.raises(InputError, match="red, green and blue differ"):
            find_volume("a.tif", tmp_path).read()
        planes = np.moveaxis(colours, -1, 1)
        tifffile.imwrite(tmp_path / "a.tif", planes, photometric="rgb", planarconfig="separate")
        with pytest.raises(InputError, match="its colours lie in planes"):
            find_volume("a.tif", tmp_path)

    def test_grey_in_three_colours(self, tmp_path):
        grey = (VOLUME % 250).astype(np.uint8)
        tifffile.imwrite(tmp_path / "a.tif", np.stack([grey] * 3, axis=-1), photometric="rgb")
        np.testing.assert_array_equal(find_volume("a.tif", tmp_path).read(), grey)

    def test_sizes_in_several_units(self, tmp_path):
        sizes = {"PhysicalSizeX": 12.5, "PhysicalSizeY": 12.5, "PhysicalSizeZ": VOXEL}
        units = {"PhysicalSizeXUnit": "µm", "PhysicalSizeYUnit": "µm", "PhysicalSizeZUnit": "mm"}
        metadata = {"axes": "ZYX", **sizes, **units}
        tifffile.imwrite(tmp_path / "a.tif", VOLUME, ome=True, photometric="minisblack", metadata=metadata)
        assert find_volume("a.tif", tmp_path).voxel.size == pytest.approx(VOXEL)
        metadata["PhysicalSizeZUnit"] = "pixel"
        tifffile.imwrite(tmp_path / "a.tif", VOLUME, ome=True, photometric="minisblack", metadata=metadata)
        volume = find_volume("a.tif", tmp_path)
        assert volume.voxel is None
        assert "in units of µm, µm, pixel" in volume.notes[0]

    def test_a_stack_called_times_is_told(self, tmp_path):
        tifffile.imwrite(tmp_path / "a.tif", VOLUME, imagej=True, metadata={"axes": "TYX"})
        volume = find_volume("a.tif", tmp_path)
        assert "called times" in volume.notes[0]
        np.testing.assert_array_equal(volume.read(), VOLUME)

    def test_voxels_that_are_no_cubes(self, tmp_path):
        imagej(tmp_path / "a.tif", "mm", 100.0, 0.02)
        voxel = find_volume("a.tif", tmp_path).voxel
        assert voxel.size is None
        assert voxel.text == "0.01 x 0.01 x 0.02 mm (x y z)"

    def test_part_of_a_volume_of_many_files(self, tmp_path):
        ome_tiff(tmp_path / "a.tif")
        text = tifffile.TiffFile(tmp_path / "a.tif").ome_metadata.replace('SizeZ="7"', 'SizeZ="9"')
        tifffile.imwrite(tmp_path / "b.tif", VOLUME, description=text.encode(), metadata=None)
        with pytest.raises(InputError, match="tells 9 slices, but 7"):
            find_volume("b.tif", tmp_path)

    def test_slices_in_two_stacks(self, tmp_path):
        tifffile.imwrite(tmp_path / "a1.tif", VOLUME[:2])
        tifffile.imwrite(tmp_path / "a2.tif", VOLUME[2:], compression="zlib")
        volume = find_volume("a*.tif", tmp_path)
        np.testing.assert_array_equal(volume.read_slab(1, 4), VOLUME[1:4])
        np.testing.assert_array_equal(find_volume(["a1.tif", "a2.tif"], tmp_path).read(), VOLUME)


class TestAxesOfOneVoxel:
    """Axes of length 1 beyond three are dropped, wherever they are."""

    @pytest.mark.parametrize("shape", [(1, *SHAPE), (*SHAPE, 1), (SHAPE[0], 1, *SHAPE[1:])])
    @pytest.mark.parametrize("file", ["a.npy", "a.tif", "a.h5", "a.zarr", "a.nrrd", "a.mha"])
    def test_are_dropped(self, tmp_path, file, shape):
        array = VOLUME.reshape(shape)
        writers = {
            "a.npy": np.save,
            "a.tif": tifffile.imwrite,
            "a.h5": lambda path, a: h5py.File(path, "w").create_dataset("a", data=a).file.close(),
            "a.zarr": lambda path, a: zarr.save_array(str(path), a),
            "a.nrrd": lambda path, a: nrrd.write(str(path), a, index_order="C"),
            "a.mha": lambda path, a: SimpleITK.WriteImage(SimpleITK.GetImageFromArray(a, isVector=False), str(path)),
        }
        writers[file](tmp_path / file, array)
        volume = find_volume(file, tmp_path)
        assert volume.shape == SHAPE
        np.testing.assert_array_equal(volume.read(), VOLUME)

    @pytest.mark.parametrize("file", ["a.npy", "a.nrrd", "a.mha"])
    def test_channels_are_refused(self, tmp_path, file):
        array = np.stack([VOLUME] * 2)
        if file == "a.npy":
            np.save(tmp_path / file, array)
        elif file == "a.nrrd":
            nrrd.write(str(tmp_path / file), array, index_order="C")
        else:
            SimpleITK.WriteImage(SimpleITK.GetImageFromArray(array, isVector=False), str(tmp_path / file))
        with pytest.raises(InputError, match=r"\(2, 7, 6, 5\) is no volume|5 x 6 x 7 x 2: no single volume"):
            find_volume(file, tmp_path)

    def test_spacings_are_those_of_the_other_axes(self, tmp_path):
        header = {"spacings": [VOXEL, VOXEL, VOXEL, 3.0], "kinds": ["domain"] * 4}
        nrrd.write(str(tmp_path / "a.nrrd"), VOLUME.transpose(2, 1, 0)[..., None], header, index_order="F")
        volume = find_volume("a.nrrd", tmp_path)
        np.testing.assert_array_equal(volume.read(), VOLUME)
        assert volume.voxel.size == pytest.approx(VOXEL)


class TestMedicalFormats:
    def test_scaled_values(self, tmp_path):
        image = nibabel.Nifti1Image(VOLUME.transpose(2, 1, 0), np.eye(4))
        image.header.set_slope_inter(0.5, -3)
        nibabel.save(image, tmp_path / "a.nii")
        raw = bytearray((tmp_path / "a.nii").read_bytes())
        raw[112:120] = np.array([0.5, -3], "<f4").tobytes()
        (tmp_path / "a.nii").write_bytes(raw)
        np.testing.assert_allclose(
            find_volume("a.nii", tmp_path).read(), nibabel.load(tmp_path / "a.nii").get_fdata().T
        )

    def test_four_dimensions(self, tmp_path):
        nibabel.save(nibabel.Nifti1Image(np.zeros((3, 4, 5, 2), np.uint8), np.eye(4)), tmp_path / "a.nii")
        with pytest.raises(InputError, match="3 x 4 x 5 x 2"):
            find_volume("a.nii", tmp_path)

    def test_labels_of_a_nifti_that_was_gzipped_in_two_parts(self, tmp_path):
        nifti(tmp_path / "a.nii")
        data = (tmp_path / "a.nii").read_bytes()
        for part, name in ((data[:400], "1"), (data[400:], "2")):
            (tmp_path / name).write_bytes(part)
            gzipped(tmp_path / name, tmp_path / f"{name}.gz")
        (tmp_path / "b.nii.gz").write_bytes((tmp_path / "1.gz").read_bytes() + (tmp_path / "2.gz").read_bytes())
        np.testing.assert_array_equal(find_volume("b.nii.gz", tmp_path).read(), VOLUME)

    def test_voxels_of_one_are_no_size(self, tmp_path):
        SimpleITK.WriteImage(SimpleITK.GetImageFromArray(VOLUME), str(tmp_path / "a.mha"))
        volume = find_volume("a.mha", tmp_path)
        assert volume.voxel is None
        assert "ElementSpacing is 1" in volume.notes[0]

    def test_a_data_file_that_is_missing(self, tmp_path):
        itk(tmp_path / "a.mhd")
        (tmp_path / "a.raw").unlink()
        with pytest.raises(InputError, match=r"ElementDataFile names a\.raw, which is not there"):
            find_volume("a.mhd", tmp_path)

    def test_a_header_with_thousands_of_materials(self, tmp_path):
        amira(tmp_path / "a.am", "HxByteRLE", kind="byte")
        data = (tmp_path / "a.am").read_bytes()
        materials = "".join(f"        Grain{k} {{ Id {k}, Color 0.1 0.2 0.3 }}\n" for k in range(9000))
        (tmp_path / "a.am").write_bytes(data.replace(b"Parameters {\n", f"Parameters {{\n{materials}".encode(), 1))
        np.testing.assert_array_equal(find_volume("a.am", tmp_path).read(), VOLUME)

    def test_runs_of_labels_in_more_than_a_byte(self, tmp_path):
        amira(tmp_path / "a.am", "HxByteRLE")
        with pytest.raises(InputError, match="HxByteRLE as ushort"):
            find_volume("a.am", tmp_path)


@pytest.mark.parametrize("name", [*SIZED, *UNSIZED, *MORE])
def test_files_cut_at_any_tenth_are_refused_or_whole(tmp_path, name, caplog):
    """Each file of a volume in turn; an error is one line that names a file, and nothing else is printed."""
    file, write = (SIZED | UNSIZED | MORE)[name]
    write(tmp_path / file)
    files = sorted((p for p in tmp_path.rglob("*") if p.is_file()), key=lambda p: p.stat().st_size)
    for path in {files[0], files[len(files) // 2], files[-1]}:
        whole = path.read_bytes()
        for end in [len(whole) * tenth // 10 for tenth in range(10)] + [len(whole) - 1]:
            path.write_bytes(whole[:end])
            message = "a.: one line"
            try:
                voxels = find_volume(file, tmp_path).read()
            except InputError as error:
                message = str(error)
            else:  # nothing of the voxels was lost
                np.testing.assert_array_equal(voxels, VOLUME)
            assert re.search(r"\b(a[.\-_/:]|slice_)", message), message
            assert "\n" not in message
        path.write_bytes(whole)
    assert not caplog.records


@pytest.mark.parametrize(
    "file", ["a.tif", "a.h5", "a.nii", "a.nii.gz", "a.mha", "a.mhd", "a.nrrd", "a.am", "a.vgi", "a.npy"]
)
@pytest.mark.parametrize("content", [b"", b"\n", b"solid cube\nfacet\n" * 50, bytes(range(256)) * 8])
def test_files_of_other_formats_are_refused(tmp_path, file, content):
    (tmp_path / file).write_bytes(content)
    with pytest.raises(InputError, match=r"a\."):
        find_volume(file, tmp_path).read()


class TestNames:
    def test_several_files_of_a_format_of_one_file(self, tmp_path):
        for name in ("a.mha", "b.mha"):
            itk(tmp_path / name)
        with pytest.raises(InputError, match=r'2 files match, each a volume; name one, as "a\.mha"'):
            find_volume("*.mha", tmp_path)
        with pytest.raises(InputError, match="one file; give this file alone"):
            find_volume(["a.mha", "b.mha"], tmp_path)
        (tmp_path / "b.mha").unlink()
        np.testing.assert_array_equal(find_volume("*.mha", tmp_path).read(), VOLUME)

    def test_a_misprint(self, tmp_path):
        nifti(tmp_path / "labels.nii.gz")
        with pytest.raises(InputError, match=r"no such file; did you mean 'labels\.nii\.gz'"):
            find_volume("label.nii.gz", tmp_path)
        with pytest.raises(InputError, match="'::' is for raw"):
            find_volume("labels.nii.gz::1", tmp_path)

    def test_sizes_in_a_name_without_a_type(self, tmp_path):
        VOLUME.astype("f4").tofile(tmp_path / "a_5x6x7.raw")
        with pytest.raises(InputError, match=r'give "a_5x6x7\.raw::float32,x=5,y=6,z=7"'):
            find_volume("a_5x6x7.raw", tmp_path)


class TestChunks:
    """Slabs hold whole chunks, so that none is decompressed twice."""

    def test_hdf5(self, tmp_path, monkeypatch):
        monkeypatch.setattr(record, "SLAB_BYTES", 1)
        with h5py.File(tmp_path / "a.h5", "w") as file:
            file.create_dataset("a", data=VOLUME, chunks=(3, 2, 2))
        assert find_volume("a.h5", tmp_path).bounds == [(0, 3), (3, 6), (6, 7)]

    def test_zarr_with_shards(self, tmp_path, monkeypatch):
        monkeypatch.setattr(record, "SLAB_BYTES", 1)
        array = zarr.create_array(str(tmp_path / "a.zarr"), shape=SHAPE, shards=(4, 4, 4), chunks=(2, 2, 2), dtype="u2")
        array[:] = VOLUME
        volume = find_volume("a.zarr", tmp_path)
        assert volume.bounds == [(0, 4), (4, 7)]
        assert volume.notes == ()
        np.testing.assert_array_equal(volume.read(), VOLUME)

    def test_zarr_without_a_shard(self, tmp_path):
        """Shards reach beyond this volume: those that are left hold more chunks than the volume has."""
        array = zarr.create_array(str(tmp_path / "a.zarr"), shape=SHAPE, shards=(4, 4, 4), chunks=(2, 2, 2), dtype="u2")
        array[:] = VOLUME
        (tmp_path / "a.zarr" / "c" / "0" / "0" / "0").unlink()
        assert "1 of 8 shards are not stored and read as 0" in find_volume("a.zarr", tmp_path).notes[0]

    def test_an_old_zarr(self, tmp_path, monkeypatch):
        monkeypatch.setattr(zarr, "__version__", "3.1.1")
        with pytest.raises(InputError, match=r"zarr 3\.1\.1 is too old.*zarr>=3\.1\.2"):
            find_volume("a.zarr", tmp_path)


def test_a_single_page_before_many_planes(tmp_path):
    """ImageJ's way beyond 4 GB: one page directory, all planes behind one another."""
    text = f"ImageJ=1.53t\nimages={SHAPE[0]}\nslices={SHAPE[0]}\nunit=micron\nspacing=12.5\nloop=false\n"
    tifffile.imwrite(
        tmp_path / "a.tif", VOLUME[0], description=text, metadata=None, byteorder=">", resolution=(0.08, 0.08),
        resolutionunit="NONE",
    )  # fmt: skip
    with tifffile.TiffFile(tmp_path / "a.tif") as file:
        assert file.pages[0].dataoffsets[0] + VOLUME[0].nbytes == (tmp_path / "a.tif").stat().st_size
    with (tmp_path / "a.tif").open("ab") as file:
        file.write(VOLUME[1:].astype(">u2").tobytes())
    volume = find_volume("a.tif", tmp_path)
    np.testing.assert_array_equal(volume.read(), VOLUME)
    assert volume.voxel.size == pytest.approx(VOXEL)


@pytest.mark.parametrize(
    "name", ["ImageJ", "OME-TIFF, mm, BigTIFF", "OME-Zarr 0.4", "OME-Zarr 0.5", "NRRD", "AmiraMesh"]
)
def test_damaged_headers_are_refused_in_one_line(tmp_path, name):
    """Bytes of the header changed at random: the file is read, or refused by an InputError of one line."""
    file, write = SIZED[name]
    write(tmp_path / file)
    target = tmp_path / file
    if target.is_dir():
        target = next(p for p in target.rglob("*") if p.name in (".zattrs", "zarr.json"))
    whole, rng = target.read_bytes(), np.random.default_rng(0)
    for _ in range(25):
        data = bytearray(whole)
        for place in rng.integers(0, min(len(data), 600), 3):
            data[place] = rng.integers(0, 256)
        target.write_bytes(data)
        try:
            volume = find_volume(file, tmp_path)
            if np.prod(volume.shape, dtype=float) < 1e6:
                volume.read()
        except InputError as error:
            message = str(error)
        else:
            message = ""
        assert "\n" not in message


def test_a_folder_that_is_no_zarr(tmp_path):
    (tmp_path / "a.zarr").mkdir()
    with pytest.raises(InputError, match=r"a\.zarr"):
        find_volume("a.zarr", tmp_path)
    with pytest.raises(InputError, match=r"b\.zarr"):
        find_volume("b.zarr", tmp_path)
