"""MetaImage (``.mha``, or ``.mhd`` beside its data): the format of ITK, SimpleITK and elastix.

``DimSize`` and ``ElementSpacing`` are x, y, z; x varies fastest.  Lengths are mm, as ITK takes them, unless
``DistanceUnits`` tells another unit.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType

import numpy as np

from grainmotion.errors import InputError
from grainmotion.io.volumes.headers import axes_xyz, data_file, header_bytes, numbers_of, wanted, whole_numbers
from grainmotion.io.volumes.raw_data import RawLayout, check_bytes, raw_slabs
from grainmotion.io.volumes.record import VolumeFile
from grainmotion.io.volumes.units import told_voxel

META_IMAGE = (".mhd", ".mha")
_ELEMENTS: Mapping[str, str] = MappingProxyType({
    "MET_UCHAR": "u1", "MET_CHAR": "i1", "MET_USHORT": "u2", "MET_SHORT": "i2", "MET_UINT": "u4", "MET_INT": "i4",
    "MET_ULONG": "u4", "MET_LONG": "i4", "MET_ULONG_LONG": "u8", "MET_LONG_LONG": "i8", "MET_FLOAT": "f4",
    "MET_DOUBLE": "f8",
})  # fmt: skip


def metaimage_volume(path: Path, spec: str) -> VolumeFile:
    """The volume of a MetaImage file."""
    keys, end = _keys(path)
    dimensions = whole_numbers(path, "NDims", wanted(path, keys, "NDims"), 1)[0]
    if int(numbers_of(keys.get("ElementNumberOfChannels", "1"))[0]) != 1:
        raise InputError(str(path), "several channels (ElementNumberOfChannels)", "export one of them")
    sizes = whole_numbers(path, "DimSize", wanted(path, keys, "DimSize"), dimensions)
    axes = axes_xyz(path, "DimSize", sizes)
    nx, ny, nz = (sizes[axis] for axis in axes)
    element = wanted(path, keys, "ElementType").strip()
    if element not in _ELEMENTS:
        raise InputError(str(path), f"ElementType = {element} is unknown", f"known are {', '.join(_ELEMENTS)}")
    if keys.get("BinaryData", "True").strip() == "False":
        raise InputError(str(path), "its voxels are written as text (BinaryData = False)", "export it in binary")
    msb = keys.get("BinaryDataByteOrderMSB", keys.get("ElementByteOrderMSB", "False")).strip()
    dtype = np.dtype((">" if msb == "True" else "<") + _ELEMENTS[element])
    name = wanted(path, keys, "ElementDataFile").strip()
    if name.split()[:1] == ["LIST"] or "%" in name:
        raise InputError(str(path), f"ElementDataFile = {name}: a file a slice", "name the files of the slices instead")
    local = name.upper() == "LOCAL"
    file = path if local else data_file(path, name, "ElementDataFile")
    offset = end if local else int((numbers_of(keys.get("HeaderSize", "0")) or [0])[0])
    layout = RawLayout(file, (nz, ny, nx), dtype, 0, keys.get("CompressedData", "False").strip() == "True")
    if offset < 0:  # the voxels are at the end of the file
        offset = file.stat().st_size - layout.bytes
    layout = RawLayout(file, layout.shape, dtype, offset, layout.compressed)
    check_bytes(layout, str(path))
    spacing = numbers_of(keys.get("ElementSpacing", keys.get("ElementSize", "")))
    spacing = [spacing[axis] for axis in axes] if len(spacing) == dimensions else []
    voxel, notes = told_voxel(spacing, keys.get("DistanceUnits", "mm"), "ElementSpacing", one_is_default=True)
    files = (path,) if local else (path, file)
    return VolumeFile(spec, files, layout.shape, dtype, raw_slabs(layout), voxel, notes=notes)


def _keys(path: Path) -> tuple[dict[str, str], int]:
    """The keys of the header up to ``ElementDataFile``, its last one, and the bytes up to its end."""
    data, keys, place = header_bytes(path), dict[str, str](), 0
    while place < len(data):
        end = data.find(b"\n", place)
        end = len(data) if end < 0 else end
        name, equals, value = data[place:end].decode("latin-1").partition("=")
        if not equals and name.strip():
            break
        place = end + 1
        keys[name.strip()] = value.strip("\r")
        if name.strip() == "ElementDataFile":
            return keys, place
    remedy = "copy or export the file again"
    raise InputError(str(path), "no MetaImage header: it lacks ElementDataFile", remedy)
