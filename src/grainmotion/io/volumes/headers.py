"""Text headers of keys and values, and files that they name."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from grainmotion.errors import InputError
from grainmotion.io.volumes.record import volume_axes

HEADER_BYTES = 262_144
"""Bytes at the beginning of a file in which its text header must end."""


def header_bytes(path: Path, limit: int = HEADER_BYTES) -> bytes:
    """The beginning of a file."""
    with path.open("rb") as file:
        return file.read(limit)


def data_file(header: Path, name: str, key: str) -> Path:
    """The file of voxels that a header names, beside it; paths of other machines are tried by their last part."""
    name = name.strip().strip('"')
    for candidate in (header.parent / name, header.parent / name.replace("\\", "/").rpartition("/")[2]):
        if candidate.is_file():
            return candidate
    fact = f"{key} names {name}, which is not there"
    raise InputError(str(header), fact, "copy it beside the header, or correct the name in the header")


def whole_numbers(header: Path, key: str, text: str, count: int) -> list[int]:
    """So many whole numbers of a key."""
    try:
        numbers = [int(word) for word in text.split()]
    except ValueError:
        numbers = []
    if len(numbers) != count:
        fact = f"{key} = '{text.strip()}' is not {count} whole numbers"
        raise InputError(str(header), fact, "give a volume with sizes along x, y, z")
    return numbers


def axes_xyz(header: Path, key: str, sizes: Sequence[int]) -> tuple[int, int, int]:
    """Which axes of a header, the fastest first, are x, y and z: all but those of one voxel beyond three."""
    try:
        z, y, x = volume_axes(sizes[::-1], (), str(header))
    except InputError as error:
        fact = f"{key} = {' x '.join(map(str, sizes))}: no single volume"
        raise InputError(str(header), fact, "export one volume of 3 dimensions, without channels or times") from error
    last = len(sizes) - 1
    return last - x, last - y, last - z


def numbers_of(text: str) -> list[float]:
    """Numbers in a text; none if it holds anything else."""
    try:
        return [float(word) for word in text.replace(",", " ").split()]
    except ValueError:
        return []


def wanted(header: Path, keys: dict[str, str], key: str) -> str:
    """The value of a key that must be there."""
    if key not in keys:
        raise InputError(str(header), f"its header lacks {key}", "export it again, or give the data file by its sizes")
    return keys[key]
