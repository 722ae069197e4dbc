"""OME-Zarr 0.4 and 0.5 (Zarr 2 and 3), and plain Zarr arrays; chunks are read slab by slab, by the package zarr."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager
from math import prod
from pathlib import Path
from typing import TYPE_CHECKING

from grainmotion.errors import InputError
from grainmotion.io.volumes.record import Sliceable, VolumeFile, sliced, volume_axes
from grainmotion.io.volumes.zarr_metadata import OmeImage, told_center

if TYPE_CHECKING:
    import zarr

ZARR = (".zarr", ".zarr.zip", ".ozx")
ZARR_FILES = (".zattrs", ".zgroup", ".zarray", "zarr.json")
ZIPPED = (".zip", ".ozx")
_BLOSC_HEADER, _BLOSC_LENGTH = 16, slice(12, 16)
"""Bytes of the header of a chunk, and those that tell the chunk's length."""
_OLDEST = (3, 1, 2)
"""Earlier versions of zarr count shards as if each were one chunk."""
_COPY_STORE = "copy or export the folder again, with all its files"


def is_zarr(path: Path) -> bool:
    """Whether a path is a Zarr store."""
    return path.name.lower().endswith(ZARR) or (path.is_dir() and any((path / name).is_file() for name in ZARR_FILES))


def zarr_volume(path: Path, spec: str, inner: str) -> VolumeFile:
    """A level of an OME-Zarr image, its finest unless ``inner`` names another, or a plain array."""
    node = _opened(path)
    array, group, image = _array(node, spec, inner)
    where = f"{path}::{array.path}" if array.path else str(path)
    order = volume_axes(array.shape, _names(array) if image is None else image.axes, where)
    level = array.path.removeprefix("" if group is None else group.path).strip("/")
    voxel, notes = (None, ()) if image is None else image.voxel(level, order)
    stored, objects = _stored(array)
    if stored == 0:
        raise InputError(where, "none of its chunks is stored: it would read as zeros", _COPY_STORE)
    if stored < objects:
        held = "shards" if array.shards else "chunks"
        notes = (*notes, f"{objects - stored} of {objects} {held} are not stored and read as {array.fill_value}")
    shape = (array.shape[order[0]], array.shape[order[1]], array.shape[order[2]])
    files = _files(path, array.path)

    @contextmanager
    def data() -> Iterator[Sliceable]:
        _check_blosc(array, files, where)
        try:
            yield array
        except Exception as error:
            raise InputError(where, f"a chunk cannot be read ({error})", _COPY_STORE) from error

    center = None if group is None else told_center(group.attrs)
    depth = (array.shards or array.chunks)[order[0]]
    slabs = sliced(data, order, array.ndim)
    return VolumeFile(spec, files, shape, array.dtype, slabs, voxel, center, notes, (array.path,), depth)


def _stored(array: zarr.Array) -> tuple[int, int]:
    """How many of an array's objects are stored, and how many it has: shards where chunks lie in shards."""
    held = array.shards or array.chunks
    objects = prod(-(-size // side) for size, side in zip(array.shape, held))
    return int(array.nchunks_initialized) * prod(array.chunks) // prod(held), objects


def import_zarr(where: str) -> None:
    """Say how to install zarr if it is missing."""
    try:
        import zarr
    except ImportError as error:
        remedy = "install it: pip install 'grainmotion[zarr]', or use TIFF or HDF5"
        raise InputError(where, "Zarr needs the package zarr, which is not installed", remedy) from error
    if tuple(map(int, re.findall(r"\d+", zarr.__version__)[:3])) < _OLDEST:
        oldest = ".".join(map(str, _OLDEST))
        raise InputError(where, f"zarr {zarr.__version__} is too old", f"pip install --upgrade 'zarr>={oldest}'")


def _opened(path: Path) -> zarr.Group | zarr.Array:
    import_zarr(str(path))
    import zarr
    from zarr.storage import LocalStore, ZipStore

    if not path.exists():
        raise InputError(str(path), "no such folder", "check the path; paths start at the experiment file's folder")
    try:
        store = ZipStore(path, mode="r") if path.is_file() else LocalStore(path, read_only=True)
        return zarr.open(store=store, mode="r", use_consolidated=False)
    except Exception as error:
        raise InputError(str(path), f"no Zarr store, or a damaged one ({error})", _COPY_STORE) from error


def _array(
    node: zarr.Group | zarr.Array, spec: str, inner: str
) -> tuple[zarr.Array, zarr.Group | None, OmeImage | None]:
    """The array of a level or path, and the group of its image if there is one."""
    import zarr

    parts = [part for part in inner.split("/") if part]
    while isinstance(node, zarr.Group):
        image = OmeImage.of(node.attrs)
        if image is not None:
            level = "/".join(parts) or image.paths[0]
            if level not in image.paths and level.isdigit() and int(level) < len(image.paths):
                level = image.paths[int(level)]
            if level in image.paths:
                return _level(node, level, spec), node, image
            if node.get("/".join(parts)) is None:
                raise InputError(spec, f"it has no level '{level}'", f"give one of {', '.join(image.paths)}")
        node, parts = _entered(node, parts, spec)
    if parts:
        raise InputError(spec, f"'{'/'.join(parts)}' is not in its array", "leave it out")
    return node, None, None


def _level(group: zarr.Group, level: str, spec: str) -> zarr.Array:
    import zarr

    array = group.get(level)
    if not isinstance(array, zarr.Array):
        raise InputError(spec, f"its level '{level}' is missing", _COPY_STORE)
    return array


def _entered(group: zarr.Group, parts: list[str], spec: str) -> tuple[zarr.Group | zarr.Array, list[str]]:
    """What a path names; without one, the only array or image."""
    import zarr

    named = group.get("/".join(parts)) if parts else None
    if named is not None:
        return named, []
    members = dict(group.members())
    if not parts:
        arrays = [name for name, item in members.items() if isinstance(item, zarr.Array)]
        images = [n for n, item in members.items() if isinstance(item, zarr.Group) and OmeImage.of(item.attrs)]
        parts = arrays if len(arrays) == 1 else images if len(images) == 1 else []
    if not parts or parts[0] not in members or len(parts) > 1:
        fact = f"it has no '{'/'.join(parts)}'" if parts else "it holds no OME-Zarr image"
        held = ", ".join(members) or "nothing"
        raise InputError(spec, fact, f'name an array in it as "scan.zarr::name"; it holds {held}')
    return members[parts[0]], []


def _names(array: zarr.Array) -> list[str]:
    """Names of the axes of an array of Zarr 3, or of xarray, if they are z, y, x."""
    told = getattr(array.metadata, "dimension_names", None) or array.attrs.get("_ARRAY_DIMENSIONS")
    names = [str(name) for name in told if name] if isinstance(told, list | tuple) else []
    return names if len(names) == array.ndim and {"z", "y", "x"} <= {name.lower() for name in names} else []


def _check_blosc(array: zarr.Array, files: tuple[Path, ...], where: str) -> None:
    """Refuse truncated chunks of Blosc, which does not notice that the bytes of an uncompressed block are missing."""
    if array.shards is not None or not any("Blosc" in type(codec).__name__ for codec in array.compressors):
        return
    for file in files:
        if file.name in ZARR_FILES or file.suffix in ZIPPED:
            continue
        with file.open("rb") as stream:
            header = stream.read(_BLOSC_HEADER)
        if int.from_bytes(header[_BLOSC_LENGTH], "little") != file.stat().st_size:
            raise InputError(where, f"a chunk is truncated ({file.name})", _COPY_STORE)


def _files(path: Path, relative: str) -> tuple[Path, ...]:
    """The files of an array and of the groups around it."""
    if path.is_file():
        return (path,)
    around = [path, *(path / "/".join(relative.split("/")[:k]) for k in range(1, relative.count("/") + 1))]
    headers = [folder / name for folder in around for name in ZARR_FILES if (folder / name).is_file()]
    chunks = sorted(file for file in (path / relative).rglob("*") if file.is_file())
    return tuple(dict.fromkeys([*headers, *chunks]))
