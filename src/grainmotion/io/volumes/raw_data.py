"""Voxels as bare bytes, plain or compressed by zlib or gzip, of which a header elsewhere tells type and sizes."""

from __future__ import annotations

import zlib
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

import numpy as np

from grainmotion._typing import Pixels
from grainmotion.errors import InputError
from grainmotion.io.files import checked_file
from grainmotion.io.volumes.record import Bounds, Slabs

MAX_HEADER_BYTES = 65_536
"""Surplus bytes up to which a file is thought to begin with a header."""
_BLOCK = 1 << 20  # bytes that are decompressed at a time
_MAX_INFLATED = 1 << 24  # bytes that they become at a time: labels shrink a thousandfold


@dataclass(frozen=True)
class RawLayout:
    """How voxels lie in a file: x varies fastest, then y, then z."""

    path: Path
    shape: tuple[int, int, int]  # z, y, x
    dtype: np.dtype
    offset: int = 0  # bytes before the first voxel
    compressed: bool = False  # by zlib or gzip

    @property
    def bytes(self) -> int:
        """Bytes of all voxels."""
        nz, ny, nx = self.shape
        return nz * ny * nx * self.dtype.itemsize


def check_bytes(layout: RawLayout, where: str, *, more_allowed: bool = False) -> None:
    """Refuse a file whose size does not fit, and name what would fit."""
    checked_file(layout.path)
    if min(layout.shape) < 1 or layout.offset < 0:
        raise InputError(where, f"sizes {layout.shape[::-1]} (x, y, z) hold no voxel", "give sizes > 0")
    if layout.compressed:
        return
    size = layout.path.stat().st_size
    held = size - layout.offset
    if held == layout.bytes or (more_allowed and held > layout.bytes):
        return
    nz, ny, nx = layout.shape
    fact = f"{nx} x {ny} x {nz} voxels (x y z) of {layout.dtype.name} are {layout.bytes} bytes"
    if layout.offset:
        fact += f" after a header of {layout.offset}"
    raise InputError(where, f"{fact}, but {layout.path.name} has {size}", _what_fits(layout, held))


def _what_fits(layout: RawLayout, held: int) -> str:
    """Sizes, types or a header that so many bytes would fit."""
    nz, ny, nx = layout.shape
    voxels, fits = nz * ny * nx, list[str]()
    for name in ("uint8", "uint16", "float32", "float64"):
        if held == voxels * np.dtype(name).itemsize:
            fits.append(f"{name} of these sizes")
    plane = ny * nx * layout.dtype.itemsize
    if held > 0 and held % plane == 0:
        fits.append(f"z = {held // plane} planes of this size")
    surplus = held - layout.bytes
    if 0 < surplus <= MAX_HEADER_BYTES and not fits:
        fits.append(f"a header of {surplus + layout.offset} bytes, offset={surplus + layout.offset}")
    if not fits:
        return "check sizes and type, or copy the file again: it may be truncated"
    return f"{' or '.join(fits)} would fit; or copy the file again if it is truncated"


def raw_slabs(layout: RawLayout) -> Slabs:
    """Reads slabs; a compressed file is decompressed from its beginning, once."""

    def slabs(bounds: Iterable[Bounds]) -> Iterator[Pixels]:
        _, ny, nx = layout.shape
        plane = ny * nx * layout.dtype.itemsize
        with layout.path.open("rb") as file:
            file.seek(layout.offset)
            stream = _Inflated(file, layout.path) if layout.compressed else None
            place = 0
            for first, last in bounds:
                if stream is None:
                    file.seek(layout.offset + first * plane)
                    data = file.read((last - first) * plane)
                else:
                    for _ in range(place, first):
                        stream.read(plane)
                    data, place = stream.read((last - first) * plane), last
                if len(data) < (last - first) * plane:
                    fact = f"it ends within planes {first} to {last - 1} of {layout.shape[0]}"
                    raise InputError(str(layout.path), fact, "copy the file again, or correct sizes and type")
                yield np.frombuffer(data, layout.dtype).reshape(last - first, ny, nx)

    return slabs


class _Inflated:
    """A stream compressed by zlib or gzip, decompressed as it is read."""

    def __init__(self, file: BinaryIO, path: Path) -> None:
        self._file, self._path = file, path
        self._held = bytearray()
        self._inflate = zlib.decompressobj(wbits=47)  # zlib's or gzip's header

    def read(self, count: int) -> bytes:
        """The next ``count`` bytes, fewer at the end."""
        while len(self._held) < count:
            if self._inflate.eof:  # another member of a gzip file may follow
                block = self._inflate.unused_data or self._file.read(_BLOCK)
                if not block.startswith(b"\x1f\x8b"):
                    break
                self._inflate = zlib.decompressobj(wbits=47)
            else:
                block = self._inflate.unconsumed_tail or self._file.read(_BLOCK)
            try:
                inflated = self._inflate.decompress(block, _MAX_INFLATED)
            except zlib.error as error:
                fact = f"its compressed voxels are damaged ({error})"
                raise InputError(str(self._path), fact, "copy or export the file again") from error
            if not block and not inflated:
                break
            self._held += inflated
        data = bytes(self._held[:count])
        del self._held[:count]
        return data
