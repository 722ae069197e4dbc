"""AmiraMesh (``.am``): uniform lattices in binary, plain, or compressed by ``HxByteRLE`` or ``HxZip`` as labels are.

``define Lattice`` gives x, y, z; x varies fastest.  ``BoundingBox`` holds the **centres** of the first and the last
voxel, so an edge is (end - start) / (voxels - 1).
"""

from __future__ import annotations

import re
import zlib
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from types import MappingProxyType

import numpy as np

from grainmotion._typing import Pixels
from grainmotion.errors import InputError
from grainmotion.io.volumes.headers import header_bytes, numbers_of
from grainmotion.io.volumes.raw_data import RawLayout, check_bytes, raw_slabs
from grainmotion.io.volumes.record import Bounds, Slabs, VolumeFile
from grainmotion.io.volumes.units import ToldVoxel, told_voxel

AMIRA = (".am",)
MAX_AMIRA_HEADER = 1 << 24
"""Bytes in which the header must end: Avizo lists name and colour of every label in it."""
_AMIRA_TYPES: Mapping[str, str] = MappingProxyType({
    "byte": "u1", "short": "i2", "ushort": "u2", "int": "i4", "int32": "i4", "uint": "u4", "float": "f4", "double": "f8"
})  # fmt: skip
_TIFF_INSTEAD = "save it in Avizo as TIFF, or as AmiraMesh binary"
_LATTICE = re.compile(
    r"^\s*Lattice\s*\{\s*(\w+)(\[\s*\d+\s*\])?\s+\"?([\w ]+?)\"?\s*\}\s*=?\s*@(\d+)(?:\((\w+),(\d+)\))?", re.M
)


def amira_volume(path: Path, spec: str) -> VolumeFile:
    """The first lattice of an AmiraMesh file."""
    data = header_bytes(path, MAX_AMIRA_HEADER)
    first = data.split(b"\n", 1)[0].decode("latin-1").strip()
    if not re.match(r"#\s*(AmiraMesh|HyperMesh|Avizo)\b", first):
        raise InputError(str(path), "no AmiraMesh file: its first line tells another format", _TIFF_INSTEAD)
    if "ASCII" in first.upper():
        raise InputError(str(path), "its voxels are written as text (ASCII)", _TIFF_INSTEAD)
    start = re.search(rb"\n@1\r?\n", data)
    text = data[: start.start() if start else len(data)].decode("latin-1")
    sizes, field = re.search(r"define\s+Lattice\s+(\d+)\s+(\d+)\s+(\d+)", text), _LATTICE.search(text)
    if start is None or sizes is None or field is None:
        raise InputError(str(path), "it holds no lattice of voxels, or its header is truncated", _TIFF_INSTEAD)
    kind, vector, name, stream, encoding, count = field.groups()
    if vector or kind not in _AMIRA_TYPES or stream != "1":
        raise InputError(str(path), f"lattice '{name}' of {kind}{vector or ''} is no volume", "export one scalar field")
    if re.search(r"CoordType\s+\"(?!uniform)", text):
        raise InputError(str(path), "its voxels are not of one size (CoordType)", "resample it to uniform voxels")
    nx, ny, nz = (int(n) for n in sizes.groups())
    dtype = np.dtype(("<" if "LITTLE-ENDIAN" in first.upper() else ">") + _AMIRA_TYPES[kind])
    layout = RawLayout(path, (nz, ny, nx), dtype, start.end())
    if encoding is None:
        check_bytes(layout, str(path), more_allowed=True)
        slabs = raw_slabs(layout)
    elif encoding == "HxZip":
        slabs = _decoded(layout, int(count), _unzip)
    elif encoding == "HxByteRLE" and dtype.itemsize == 1:
        slabs = _decoded(layout, int(count), decode_runs)
    else:
        raise InputError(str(path), f"compressed by {encoding} as {kind}", _TIFF_INSTEAD)
    voxel, notes = _voxel(text, (nx, ny, nz))
    return VolumeFile(spec, (path,), layout.shape, dtype, slabs, voxel, notes=notes)


def _voxel(text: str, sizes: tuple[int, int, int]) -> tuple[ToldVoxel | None, tuple[str, ...]]:
    box = re.search(r"BoundingBox\s+([-+0-9.eE \t]+)", text)
    ends = numbers_of(box[1]) if box else []
    if len(ends) != 6:
        return None, ()
    edges = [(ends[2 * k + 1] - ends[2 * k]) / (n - 1) if n > 1 else 0.0 for k, n in enumerate(sizes)]
    edges = [edge or max(edges) for edge in edges]  # one plane has no extent
    unit = re.search(r"Units\s*\{[^}]*Coordinates\s+\"([^\"]*)\"", text)
    return told_voxel(edges, unit[1] if unit else None, "BoundingBox", one_is_default=True)


def _decoded(layout: RawLayout, count: int, decode: Callable[[bytes, int], bytes]) -> Slabs:
    """Slabs of compressed voxels, all of which are decoded at once."""

    def slabs(bounds: Iterable[Bounds]) -> Iterator[Pixels]:
        with layout.path.open("rb") as file:
            file.seek(layout.offset)
            packed = file.read(count)
        try:
            voxels = decode(packed, layout.bytes) if len(packed) == count else b""
        except (zlib.error, ValueError) as error:
            raise InputError(str(layout.path), f"its compressed voxels are damaged ({error})", _TIFF_INSTEAD) from error
        if len(voxels) != layout.bytes:
            fact = f"truncated or damaged: {len(voxels)} bytes of voxels instead of {layout.bytes}"
            raise InputError(str(layout.path), fact, "copy or export the file again")
        array = np.frombuffer(voxels, layout.dtype).reshape(layout.shape)
        for first, last in bounds:
            yield array[first:last]

    return slabs


def _unzip(packed: bytes, size: int) -> bytes:
    return zlib.decompress(packed, bufsize=size)


def decode_runs(packed: bytes, size: int) -> bytes:
    """Undo ``HxByteRLE``: a byte above 127 announces that many less 128 bytes as they are, else a byte to repeat."""
    voxels, place, end = bytearray(), 0, len(packed)
    while place < end:
        count = packed[place]
        if count > 127:
            voxels += packed[place + 1 : place + 1 + count - 128]
            place += 1 + count - 128
        else:
            voxels += packed[place + 1 : place + 2] * count
            place += 2
        if len(voxels) > size:
            raise ValueError("more bytes than voxels")
    return bytes(voxels)
