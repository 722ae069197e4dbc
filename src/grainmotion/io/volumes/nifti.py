"""NIfTI-1 and -2 (``.nii``, ``.nii.gz``): what nnU-Net, ParticleSeg3D and biomedisa write.

Voxels are taken as they are stored: the first axis, which varies fastest, is x, then y, z.  So a file that SimpleITK,
napari or nibabel wrote of an array ``[z, y, x]`` (or ``[x, y, z]`` with nibabel) comes back as that array.  The
affine's signs, by which ITK tells that its x and y run to the left and back, are of no use here and are not applied.
"""

from __future__ import annotations

import gzip
import struct
import zlib
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType

import numpy as np

from grainmotion._typing import Pixels
from grainmotion.errors import InputError
from grainmotion.io.volumes.raw_data import RawLayout, check_bytes, raw_slabs
from grainmotion.io.volumes.record import Bounds, Slabs, VolumeFile
from grainmotion.io.volumes.units import told_voxel

NIFTI = (".nii", ".nii.gz")
_DATATYPES: Mapping[int, str] = MappingProxyType({
    2: "u1", 4: "i2", 8: "i4", 16: "f4", 64: "f8", 256: "i1", 512: "u2", 768: "u4", 1024: "i8", 1280: "u8"
})  # fmt: skip
_LENGTH_UNITS: Mapping[int, str] = MappingProxyType({1: "m", 2: "mm", 3: "um"})
_HEADER_SIZES = {348: 1, 540: 2}
_COPY_AGAIN = "copy or export the file again"


@dataclass(frozen=True)
class _Header:
    """What is used of a header."""

    dims: tuple[int, ...]  # number of axes, then sizes
    datatype: int
    edges: tuple[float, ...]
    offset: int
    slope: float
    intercept: float
    unit: str | None
    order: str


def nifti_volume(path: Path, spec: str) -> VolumeFile:
    """The volume of a NIfTI file."""
    compressed = path.name.lower().endswith(".gz")
    header = _header(path, compressed)
    axes = header.dims[0]
    sizes = header.dims[1 : axes + 1] if 1 <= axes <= 7 else ()
    if len(sizes) < 3 or any(n != 1 for n in sizes[3:]) or min(sizes) < 1:
        fact = f"its sizes {' x '.join(map(str, sizes)) or axes} are no single volume"
        raise InputError(str(path), fact, "export one channel and one time")
    nx, ny, nz = sizes[:3]
    if header.datatype not in _DATATYPES:
        fact = f"datatype {header.datatype} holds no single number a voxel"
        raise InputError(str(path), fact, "export it as 8 or 16 bits, or as float")
    dtype = np.dtype(header.order + _DATATYPES[header.datatype])
    layout = RawLayout(path, (nz, ny, nx), dtype, 0 if compressed else header.offset, compressed)
    check_bytes(layout, str(path), more_allowed=True)
    slabs = _behind_header(layout, header.offset) if compressed else raw_slabs(layout)
    if header.slope not in (0.0, 1.0) or (header.slope != 0 and header.intercept != 0):
        slabs, dtype = _scaled(slabs, header.slope, header.intercept), np.dtype(np.float32)
    voxel, notes = told_voxel(header.edges, header.unit, "pixdim", one_is_default=True)
    return VolumeFile(spec, (path,), (nz, ny, nx), dtype, slabs, voxel, notes=notes)


def _header(path: Path, compressed: bool) -> _Header:
    try:
        with gzip.open(path) if compressed else path.open("rb") as file:
            data = file.read(540)
    except (OSError, EOFError, zlib.error) as error:
        raise InputError(str(path), f"truncated or damaged gzip ({error})", _COPY_AGAIN) from error
    for order in "<>":
        version = _HEADER_SIZES.get(struct.unpack(order + "i", data[:4])[0]) if len(data) >= 348 else None
        if version == 1 and data[344:347] in (b"n+1", b"ni1"):
            dims = struct.unpack_from(order + "8h", data, 40)
            edges = struct.unpack_from(order + "3f", data, 80)
            offset, slope, intercept = struct.unpack_from(order + "3f", data, 108)
            datatype, units = struct.unpack_from(order + "h", data, 70)[0], data[123]
            break
        if version == 2 and len(data) >= 540:
            dims = struct.unpack_from(order + "8q", data, 16)
            edges = struct.unpack_from(order + "3d", data, 112)
            offset, slope, intercept = struct.unpack_from(order + "q2d", data, 168)
            datatype, units = (
                struct.unpack_from(order + "h", data, 12)[0],
                struct.unpack_from(order + "i", data, 500)[0],
            )
            break
    else:
        raise InputError(str(path), "no NIfTI file, or a truncated one: its header is not known", _COPY_AGAIN)
    if data[344:347] == b"ni1":
        raise InputError(str(path), "its voxels lie in an .img file", "export it as one .nii or .nii.gz")
    edges = tuple(float(f"{edge:.7g}") for edge in edges)  # of single precision
    unit = _LENGTH_UNITS.get(units & 7)
    slope, intercept = (0.0, 0.0) if not np.isfinite([slope, intercept]).all() else (slope, intercept)
    return _Header(dims, datatype, edges, int(offset), slope, intercept, unit, order)


def _behind_header(layout: RawLayout, offset: int) -> Slabs:
    """Slabs of a compressed file whose header is compressed with the voxels: as bytes, behind so many of them."""
    plane = layout.shape[1] * layout.shape[2] * layout.dtype.itemsize

    def slabs(bounds: Iterable[Bounds]) -> Iterator[Pixels]:
        try:
            with gzip.open(layout.path) as file:
                for first, last in bounds:
                    file.seek(offset + first * plane)
                    data = file.read((last - first) * plane)
                    if len(data) < (last - first) * plane:
                        raise EOFError(f"it ends within planes {first} to {last - 1}")
                    yield np.frombuffer(data, layout.dtype).reshape(last - first, *layout.shape[1:])
        except (OSError, EOFError, zlib.error) as error:
            raise InputError(str(layout.path), f"truncated or damaged gzip ({error})", _COPY_AGAIN) from error

    return slabs


def _scaled(slabs: Slabs, slope: float, intercept: float) -> Slabs:
    """Slabs of the values that the header means by those stored."""

    def scaled(bounds: Iterable[Bounds]) -> Iterator[Pixels]:
        for slab in slabs(bounds):
            yield (slope * slab.astype(np.float64) + intercept).astype(np.float32)

    return scaled
