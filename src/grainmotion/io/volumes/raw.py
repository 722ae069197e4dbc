"""Bytes without a header: type and sizes from the specification, from the file's name, or from a header beside it.

``"rec.raw::uint16,x=200,y=180,z=160"`` names sizes by their axis, of which x varies fastest (the columns of a slice),
so that no order has to be guessed.  In the file's name (``rec_200x180x160_uint16_le.raw``) sizes are x, y, z, as
Fiji, VGStudio and Dragonfly name them.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType

import numpy as np

from grainmotion.errors import InputError
from grainmotion.io.volumes.raw_data import RawLayout, check_bytes, raw_slabs
from grainmotion.io.volumes.record import VolumeFile

RAW = (".raw", ".vol", ".bin", ".dat", ".img")
_RAW_TYPES: Mapping[str, str] = MappingProxyType({
    name: code
    for names, code in (
        ("uint8 u8 u1 byte uchar 8bit 8-bit", "u1"),
        ("int8 i8 i1 char", "i1"),
        ("uint16 u16 u2 ushort 16bit 16-bit 16bitunsigned", "u2"),
        ("int16 i16 i2 short 16bitsigned", "i2"),
        ("uint32 u32 u4 uint", "u4"),
        ("int32 i32 i4 int", "i4"),
        ("uint64 u64", "u8"),
        ("int64 i64", "i8"),
        ("float32 f32 f4 float 32bit 32-bit", "f4"),
        ("float64 f64 f8 double", "f8"),
    )
    for name in names.split()
})  # fmt: skip
"""Names of number types; "u8" and "i8" have 8 bits, not numpy's 8 bytes."""
_SIZES = re.compile(r"(?<!\d)(\d+)\s*[x×]\s*(\d+)\s*[x×]\s*(\d+)(?!\d)")
_ORDERS: Mapping[str, str] = MappingProxyType({"little": "<", "le": "<", "big": ">", "be": ">"})


def raw_volume(path: Path, spec: str, text: str) -> VolumeFile:
    """A raw file by the ``text`` behind ``::`` of its specification, or without one by its name."""
    notes: tuple[str, ...] = ()
    if text:
        layout = _by_text(path, spec, text)
    else:
        found = _by_name(path)
        if found is None:
            fact = "bytes without a header, so that type and sizes of the volume are unknown"
            remedy = f"give {_example(path)}, x varies fastest; or its .mhd, .nhdr or .vgi"
            raise InputError(spec, fact, remedy)
        layout = found
        nz, ny, nx = layout.shape
        notes = (f"by its name {nx} x {ny} x {nz} voxels (x y z) of {layout.dtype.name}, x varying fastest",)
    check_bytes(layout, spec)
    return VolumeFile(spec, (path,), layout.shape, layout.dtype, raw_slabs(layout), notes=notes, inner=(text or None,))


def _by_text(path: Path, spec: str, text: str) -> RawLayout:
    example = _example(path)
    words = [word.strip() for word in text.split(",") if word.strip()]
    kinds = [_RAW_TYPES[w.lower()] for w in words if w.lower() in _RAW_TYPES]
    orders = [_ORDERS[w.lower()] for w in words if w.lower() in _ORDERS]
    values: dict[str, int] = {}
    for word in words:
        name, equals, number = word.partition("=")
        if word.lower() in _RAW_TYPES or word.lower() in _ORDERS:
            continue
        if not equals and word.isdigit():
            fact = f"the size '{word}' does not say along which axis"
            raise InputError(spec, fact, f"name the axes, as in {example}; x varies fastest")
        if name.strip().lower() not in ("x", "y", "z", "offset") or not number.strip().isdigit():
            raise InputError(spec, f"'{word}' is no type, size or byte order", f"write it like {example}")
        values[name.strip().lower()] = int(number)
    if len(kinds) != 1 or not {"x", "y", "z"} <= set(values) or len(orders) > 1:
        lacking = [axis for axis in "xyz" if axis not in values] + ([] if len(kinds) == 1 else ["one type"])
        raise InputError(spec, f"it lacks {', '.join(lacking) or 'one byte order'}", f"write it like {example}")
    shape = values["z"], values["y"], values["x"]
    return RawLayout(path, shape, np.dtype((orders or ["<"])[0] + kinds[0]), values.get("offset", 0))


def _by_name(path: Path) -> RawLayout | None:
    """Type and sizes in a file's name; None if they are not there, or if its bytes fit several types."""
    name = path.stem.lower()
    sizes = _SIZES.search(name)
    if sizes is None:
        return None
    x, y, z = (int(n) for n in sizes.groups())
    words = [w for w in re.split(r"[^0-9a-z]+", name[: sizes.start()] + " " + name[sizes.end() :]) if w]
    kinds = {_RAW_TYPES[w] for w in words if w in _RAW_TYPES}
    orders = {_ORDERS[w] for w in words if w in _ORDERS}
    if len(kinds) != 1 or len(orders) > 1:
        return None
    return RawLayout(path, (z, y, x), np.dtype((orders or {"<"}).pop() + kinds.pop()))


def _example(path: Path) -> str:
    """A specification of the file, with the sizes in its name and the type that these leave."""
    sizes = _SIZES.search(path.stem.lower())
    x, y, z = (int(n) for n in sizes.groups()) if sizes else (200, 180, 160)
    each = path.stat().st_size / max(1, x * y * z) if sizes else 2
    kinds: dict[float, str] = {1: "uint8", 4: "float32", 8: "float64"}
    kind = kinds.get(each, "uint16")
    return f'"{path.name}::{kind},x={x},y={y},z={z}"'
