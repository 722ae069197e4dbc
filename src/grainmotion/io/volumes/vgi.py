"""VGStudio's ``.vgi``: a text header beside the raw ``.vol`` that it names; x varies fastest, little endian."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType

import numpy as np

from grainmotion.errors import InputError
from grainmotion.io.volumes.headers import data_file, header_bytes, numbers_of, wanted, whole_numbers
from grainmotion.io.volumes.raw_data import RawLayout, check_bytes, raw_slabs
from grainmotion.io.volumes.record import VolumeFile
from grainmotion.io.volumes.units import told_voxel

VGI = (".vgi",)
_VGI_KINDS: Mapping[str, str] = MappingProxyType({
    "unsigned integer": "u", "signed integer": "i", "integer": "i", "float": "f", "floating point": "f"
})  # fmt: skip


def vgi_volume(path: Path, spec: str) -> VolumeFile:
    """The volume that a ``.vgi`` describes."""
    keys, sections = _keys(path)
    if sections.count("file2"):
        raise InputError(str(path), "its voxels lie in several files", "export the volume as one file")
    form = keys.get("fileformat", "raw").strip().lower()
    if form != "raw":
        raise InputError(str(path), f"FileFormat = {form} cannot be read", "export the volume as raw, or as TIFF")
    nx, ny, nz = whole_numbers(path, "Size", wanted(path, keys, "size"), 3)
    kind = _VGI_KINDS.get(wanted(path, keys, "datatype").strip().lower())
    bits = whole_numbers(path, "BitsPerElement", wanted(path, keys, "bitsperelement"), 1)[0]
    if kind is None or bits not in (8, 16, 32, 64) or (kind == "f" and bits < 32):
        fact = f"Datatype = {keys['datatype'].strip()} of {bits} bits is unknown"
        raise InputError(str(path), fact, "export 8 or 16 bits, or float")
    dtype = np.dtype(f"<{kind}{bits // 8}")
    file = data_file(path, wanted(path, keys, "name"), "Name")
    offset = int((numbers_of(keys.get("skipheader", "0")) or [0])[0])
    layout = RawLayout(file, (nz, ny, nx), dtype, offset)
    check_bytes(layout, str(path))
    resolution = numbers_of(keys.get("resolution", ""))
    voxel, notes = told_voxel(resolution, keys.get("unit", "mm"), "[geometry] resolution")
    return VolumeFile(spec, (path, file), layout.shape, dtype, raw_slabs(layout), voxel, notes=notes)


def _keys(path: Path) -> tuple[dict[str, str], list[str]]:
    """Keys in small letters, of ``[file1]`` and ``[geometry]``, and all sections; older ones of the same name count."""
    keys, sections, section = dict[str, str](), list[str](), ""
    for line in header_bytes(path).decode("latin-1").splitlines():
        head = re.fullmatch(r"\s*[\[{]\s*([^\]}]+?)\s*[\]}]\s*", line)
        if head:
            section = head[1].lower()
            sections.append(section)
            continue
        name, equals, value = line.partition("=")
        if equals and section in ("file1", "geometry"):
            keys.setdefault(name.strip().lower(), value.strip())
    if "file1" not in sections:
        raise InputError(
            str(path), "no header of a volume: it lacks [file1]", "name the .vgi of a reconstructed volume"
        )
    return keys, sections
