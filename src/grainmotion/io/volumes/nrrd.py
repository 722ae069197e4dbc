"""NRRD (``.nrrd``, or ``.nhdr`` beside its data): the format of 3D Slicer, teem and biomedisa's exports.

``sizes`` and spacings are those of the axes in order, of which the first varies fastest: x, y, z.  Lengths are mm
unless ``space units`` tells another unit.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType

import numpy as np

from grainmotion.errors import InputError
from grainmotion.io.volumes.headers import axes_xyz, data_file, header_bytes, numbers_of, wanted, whole_numbers
from grainmotion.io.volumes.raw_data import RawLayout, check_bytes, raw_slabs
from grainmotion.io.volumes.record import VolumeFile
from grainmotion.io.volumes.units import ToldVoxel, told_voxel

NRRD = (".nrrd", ".nhdr")
_NRRD_TYPES: Mapping[str, str] = MappingProxyType({
    name: code
    for names, code in (
        ("signed char|int8|int8_t", "i1"), ("uchar|unsigned char|uint8|uint8_t", "u1"),
        ("short|short int|signed short|signed short int|int16|int16_t", "i2"),
        ("ushort|unsigned short|unsigned short int|uint16|uint16_t", "u2"),
        ("int|signed int|int32|int32_t", "i4"), ("uint|unsigned int|uint32|uint32_t", "u4"),
        ("longlong|long long|long long int|signed long long|int64|int64_t", "i8"),
        ("ulonglong|unsigned long long|unsigned long long int|uint64|uint64_t", "u8"),
        ("float", "f4"), ("double", "f8"),
    )
    for name in names.split("|")
})  # fmt: skip


def nrrd_volume(path: Path, spec: str) -> VolumeFile:
    """The volume of an NRRD file."""
    fields, end = _fields(path)
    dimensions = whole_numbers(path, "dimension", wanted(path, fields, "dimension"), 1)[0]
    sizes = whole_numbers(path, "sizes", wanted(path, fields, "sizes"), dimensions)
    axes = axes_xyz(path, "sizes", sizes)
    nx, ny, nz = (sizes[axis] for axis in axes)
    kind = wanted(path, fields, "type").strip().lower()
    if kind not in _NRRD_TYPES:
        raise InputError(str(path), f"type: {kind} is unknown", "export it as 8 or 16 bits, or as float")
    code = _NRRD_TYPES[kind]
    endian = fields.get("endian", "little").strip().lower()
    dtype = np.dtype((">" if endian == "big" else "<") + code)
    encoding = wanted(path, fields, "encoding").strip().lower()
    if encoding not in ("raw", "gzip", "gz"):
        raise InputError(str(path), f"encoding: {encoding} cannot be read", "export it with encoding raw or gzip")
    name = fields.get("data file", fields.get("datafile", ""))
    if name.split()[:1] == ["LIST"] or "%" in name:
        raise InputError(str(path), f"data file: {name}: a file a slice", "name the files of the slices instead")
    if fields.get("line skip", "0").strip() != "0":
        raise InputError(str(path), "line skip: lines before the voxels", "export it again without")
    file = data_file(path, name, "data file") if name else path
    compressed = encoding != "raw"
    layout = RawLayout(file, (nz, ny, nx), dtype, 0, compressed)
    skip = 0 if name == "" else int((numbers_of(fields.get("byte skip", "0")) or [0])[0])
    offset = end if name == "" else file.stat().st_size - layout.bytes if skip == -1 else skip
    layout = RawLayout(file, layout.shape, dtype, offset, compressed)
    check_bytes(layout, str(path))
    voxel, notes = _voxel(fields, axes)
    return VolumeFile(
        spec, (path, file) if name else (path,), layout.shape, dtype, raw_slabs(layout), voxel, notes=notes
    )


def _voxel(fields: dict[str, str], axes: tuple[int, int, int]) -> tuple[ToldVoxel | None, tuple[str, ...]]:
    """Edges of a voxel: lengths of the space directions, else the spacings."""
    units = re.findall(r'"([^"]*)"', fields.get("space units", fields.get("units", "")))
    unit = units[0] if units and len(set(units)) == 1 else "mm" if not units else None
    if "space directions" in fields:
        rows = [numbers_of(row) for row in re.findall(r"\(([^)]*)\)", fields["space directions"])]
        lengths = [float(np.linalg.norm(row)) for row in rows]
        return told_voxel(lengths, unit, "space directions", one_is_default=True)
    spacings = numbers_of(fields.get("spacings", ""))
    spacings = [spacings[axis] for axis in axes] if len(spacings) > max(axes) else []
    return told_voxel(spacings, unit, "spacings", one_is_default=True)


def _fields(path: Path) -> tuple[dict[str, str], int]:
    """The fields of the header, and the bytes up to its end, an empty line."""
    data = header_bytes(path)
    if not data.startswith(b"NRRD000"):
        raise InputError(str(path), "no NRRD file: it does not begin with NRRD000", "copy or export the file again")
    fields, place = dict[str, str](), 0
    while place < len(data):
        end = data.find(b"\n", place)
        end = len(data) if end < 0 else end
        line = data[place:end].decode("latin-1").rstrip("\r")
        place = end + 1
        if not line:
            break
        name, colon, value = line.partition(":")
        if colon and not line.startswith("#") and not value.startswith("="):
            fields[name.strip().lower()] = value.strip()
    return fields, min(place, len(data))
