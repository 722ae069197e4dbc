"""Volumes written by other software, or by hand as its formats are described; no two axes or directions are alike."""

from __future__ import annotations

import gzip
import json
import zlib
from pathlib import Path

import h5py
import ngff_zarr
import nibabel
import nrrd
import numcodecs
import numpy as np
import SimpleITK
import tifffile
import zarr

SHAPE = (7, 6, 5)  # z, y, x
VOXEL = 0.0125  # mm
VOLUME = np.random.default_rng(0).permutation(210).reshape(SHAPE).astype(np.uint16)


def nifti(path: Path, unit: str = "mm", size: float = VOXEL) -> None:
    """By nibabel, whose arrays are [x, y, z]."""
    image = nibabel.Nifti1Image(VOLUME.transpose(2, 1, 0), np.diag([size, size, size, 1]))
    image.header.set_xyzt_units(unit)
    nibabel.save(image, path)


def nifti2(path: Path) -> None:
    """NIfTI-2."""
    image = nibabel.Nifti2Image(VOLUME.transpose(2, 1, 0), np.diag([VOXEL, VOXEL, VOXEL, 1]))
    image.header.set_xyzt_units("mm")
    nibabel.save(image, path)


def itk(path: Path, compressed: bool = False) -> None:
    """By SimpleITK, as nnU-Net and ParticleSeg3D do: arrays are [z, y, x]; the format is that of the suffix."""
    image = SimpleITK.GetImageFromArray(VOLUME)
    image.SetSpacing((VOXEL, VOXEL, VOXEL))
    SimpleITK.WriteImage(image, str(path), compressed)


def nrrd_file(path: Path, **header: object) -> None:
    """By pynrrd in C order, so that arrays are [z, y, x] and the header's axes x, y, z."""
    told = {"spacings": [10 * VOXEL] * 3, "space": "right-anterior-superior", "space units": ["um"] * 3}
    directions = {"space directions": np.eye(3) * 1000 * VOXEL, "space origin": [0, 0, 0]}
    told = {"space": told["space"], "space units": told["space units"], **directions, **header}
    nrrd.write(str(path), VOLUME, told, index_order="C")


def amira(path: Path, encoding: str = "", unit: str = "mm", kind: str = "ushort", order: str = "<") -> None:
    """AmiraMesh as Avizo writes it."""
    array = VOLUME.astype({"ushort": order + "u2", "byte": "u1", "float": order + "f4"}[kind])
    data = array.tobytes()
    if encoding == "HxZip":
        data = zlib.compress(data)
    elif encoding == "HxByteRLE":
        data = run_lengths(data)
    box = " ".join(f"0 {(n - 1) * VOXEL}" for n in SHAPE[::-1])
    first = "AmiraMesh BINARY-LITTLE-ENDIAN 2.1" if order == "<" else "AmiraMesh 3D BINARY 2.0"
    packed = f"({encoding},{len(data)})" if encoding else ""
    lines = [
        f"# {first}", "", "", f"define Lattice {SHAPE[2]} {SHAPE[1]} {SHAPE[0]}", "", "Parameters {",
        f'    Units {{\n        Coordinates "{unit}"\n    }}', f'    Content "5x6x7 {kind}, uniform coordinates",',
        f"    BoundingBox {box},", '    CoordType "uniform"', "}", "",
        f"Lattice {{ {kind} Labels }} @1{packed}", "", "# Data section follows", "@1", "",
    ]  # fmt: skip
    path.write_bytes("\n".join(lines).encode("latin-1") + data + b"\n")


def run_lengths(data: bytes) -> bytes:
    """``HxByteRLE``: runs of 3 and more as (count, value), others as (128 + count, values)."""
    packed, place = bytearray(), 0
    while place < len(data):
        run = 1
        while place + run < len(data) and run < 127 and data[place + run] == data[place]:
            run += 1
        if run >= 3:
            packed += bytes([run, data[place]])
            place += run
            continue
        count = min(100, len(data) - place)
        packed += bytes([128 + count]) + data[place : place + count]
        place += count
    return bytes(packed)


def vgi(path: Path, unit: str = "mm", size: float = VOXEL) -> None:
    """VGStudio's header beside its voxels."""
    x, y, z = SHAPE[::-1]
    VOLUME.astype("<u2").tofile(path.with_suffix(".vol"))
    path.write_text(
        f"{{volume1}}\n[representation]\nsize = {x} {y} {z}\ndatatype = unsigned integer\nbitsperelement = 16\n"
        f"[file1]\nSkipHeader = 0\nFileFormat = raw\nSize = {x} {y} {z}\nName = C:\\scans\\{path.stem}.vol\n"
        f"Datatype = unsigned integer\ndatarange = 0 -1\nBitsPerElement = 16\n{{volumeprimitive12}}\n[geometry]\n"
        f"resolution = {size} {size} {size}\nunit = {unit}\n[volume]\nvolume = volume1\n[description]\ntext = grains\n"
    )


def imagej(path: Path, unit: str = "micron", pixels: float = 1 / (1000 * VOXEL), spacing: float = 1000 * VOXEL) -> None:
    """By tifffile as ImageJ does."""
    metadata = {"axes": "ZYX", "unit": unit, "spacing": spacing}
    tifffile.imwrite(path, VOLUME, imagej=True, resolution=(pixels, pixels), metadata=metadata)


def ome_tiff(path: Path, unit: str = "µm", size: float = 1000 * VOXEL, **options: object) -> None:
    """By tifffile as Bio-Formats does."""
    sizes = {f"PhysicalSize{a}": size for a in "XYZ"} | {f"PhysicalSize{a}Unit": unit for a in "XYZ"}
    tifffile.imwrite(path, VOLUME, ome=True, metadata={"axes": "ZYX", **sizes}, photometric="minisblack", **options)


def pages(path: Path) -> None:
    """A TIFF whose pages lie apart, with pixels a centimetre."""
    with tifffile.TiffWriter(path) as writer:
        for page in VOLUME:
            writer.write(
                page, contiguous=False, metadata=None, compression="zlib", resolution=(10 / VOXEL, 10 / VOXEL),
                resolutionunit="CENTIMETER",
            )  # fmt: skip


def series(folder: Path) -> None:
    """A TIFF a slice, numbered without leading zeros."""
    folder.mkdir()
    for k, page in enumerate(VOLUME):
        tifffile.imwrite(folder / f"slice_{2 * k + 7}.tif", page)


def hdf5(path: Path, **attributes: object) -> None:
    """A dataset with attributes."""
    with h5py.File(path, "w") as file:
        file.create_dataset("exchange/data", data=VOLUME, chunks=(2, 2, 2)).attrs.update(attributes)


def ome_zarr(
    path: Path, version: str = "0.4", dims: tuple[str, ...] = ("z", "y", "x"), unit: str = "micrometer"
) -> None:
    """By ngff-zarr, with a level of half the size."""
    shape = [dict(zip("zyx", SHAPE)).get(axis, 1) for axis in dims]
    axes = [axis for axis in dims if axis in "zyx"]
    array = VOLUME.transpose(["zyx".index(axis) for axis in axes]).reshape(shape)
    scale = {axis: 1000 * VOXEL if axis in "zyx" else 1.0 for axis in dims}
    image = ngff_zarr.to_ngff_image(array, dims=list(dims), scale=scale, axes_units=dict.fromkeys(axes, unit))
    levels = ngff_zarr.to_multiscales(image, scale_factors=[{"z": 2, "y": 2, "x": 1}], axis_order="preserve")
    ngff_zarr.to_ngff_zarr(str(path), levels, version=version)


def ome_zarr_xyz(path: Path) -> None:
    """OME-Zarr whose axes are x, y, z, with a scale of the level and one of the image."""
    group = zarr.create_group(str(path), zarr_format=2)
    group.create_array("0", shape=SHAPE[::-1], dtype="u2", chunks=(3, 3, 3))[:] = VOLUME.transpose(2, 1, 0)
    scales = {
        "axes": [{"name": axis, "type": "space", "unit": "millimeter"} for axis in "xyz"],
        "datasets": [{"path": "0", "coordinateTransformations": [{"type": "scale", "scale": [VOXEL / 2] * 3}]}],
        "coordinateTransformations": [{"type": "scale", "scale": [2.0, 2.0, 2.0]}],
    }
    group.attrs["multiscales"] = [scales]


def plain_zarr(path: Path, zarr_format: int = 2) -> None:
    """An array at the root, as ParticleSeg3D writes."""
    array = zarr.create_array(str(path), shape=SHAPE, chunks=(2, 2, 2), dtype="u2", zarr_format=zarr_format)
    array[:] = VOLUME


def gzipped(source: Path, target: Path) -> None:
    """Compress a file."""
    target.write_bytes(gzip.compress(source.read_bytes()))


def ilastik(path: Path) -> None:
    """HDF5 as ilastik exports it, with an axis of one channel at the end."""
    tags = json.dumps({"axes": [{"key": key, "typeFlags": 2, "resolution": 0, "description": ""} for key in "tzyxc"]})
    with h5py.File(path, "w") as file:
        file.create_dataset("exported_data", data=VOLUME[None, ..., None]).attrs["axistags"] = tags


def compressed_hdf5(path: Path) -> None:
    """A dataset in compressed chunks."""
    with h5py.File(path, "w") as file:
        file.create_dataset("a", data=VOLUME, chunks=(2, 2, 2), compression="gzip")


def sharded(path: Path) -> None:
    """Zarr 3 with several chunks in a file."""
    array = zarr.create_array(str(path), shape=SHAPE, shards=(8, 8, 8), chunks=(2, 2, 2), dtype="u2")
    array[:] = VOLUME


def blosc_of_noise(path: Path) -> None:
    """Zarr 2 whose chunks Blosc cannot compress, so that it keeps them as they are."""
    array = zarr.create_array(
        str(path), shape=SHAPE, chunks=(3, 3, 3), dtype="u2", zarr_format=2, compressors=numcodecs.Blosc()
    )
    array[:] = VOLUME
