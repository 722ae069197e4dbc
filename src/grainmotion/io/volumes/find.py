"""Volumes by a specification of the experiment file: the format by the file's name, and its reader."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType

import numpy as np

from grainmotion._typing import Pixels
from grainmotion.errors import InputError
from grainmotion.io.files import checked_file
from grainmotion.io.formats import FORMATS, HDF5, NPY, TIFF, family
from grainmotion.io.locate import locate
from grainmotion.io.stacks import Stack, find_stack, load_npy
from grainmotion.io.volumes.amira import AMIRA, amira_volume
from grainmotion.io.volumes.hdf5_volume import hdf5_volume
from grainmotion.io.volumes.metaimage import META_IMAGE, metaimage_volume
from grainmotion.io.volumes.nifti import NIFTI, nifti_volume
from grainmotion.io.volumes.nrrd import NRRD, nrrd_volume
from grainmotion.io.volumes.raw import RAW, raw_volume
from grainmotion.io.volumes.record import Bounds, Slabs, VolumeFile, sliced, volume_axes
from grainmotion.io.volumes.tiff_reader import tiff_volume
from grainmotion.io.volumes.vgi import VGI, vgi_volume
from grainmotion.io.volumes.zarr_reader import is_zarr, zarr_volume

VOLUME_FORMATS = (
    'give a TIFF stack or series, "file.h5::/path", an OME-Zarr folder (.zarr), .npy, .mhd, .mha, .nrrd, .nii.gz, .am, '
    '.vgi, or "rec.raw::uint16,x=200,y=180,z=160"'
)
_BY_HEADER: Mapping[tuple[str, ...], Callable[[Path, str], VolumeFile]] = MappingProxyType({
    META_IMAGE: metaimage_volume, NRRD: nrrd_volume, NIFTI: nifti_volume, AMIRA: amira_volume, VGI: vgi_volume
})  # fmt: skip


def find_volume(spec: str | Path | Sequence[str | Path], folder: str | Path = ".") -> VolumeFile:
    """Locate a volume or labels and read the header; relative paths start at ``folder``, voxels are not read."""
    items = [spec] if isinstance(spec, str | Path) else list(spec)
    shown = " ".join(str(item) for item in items[:1])
    try:
        volume = _found(items, Path(folder))
    except InputError:
        raise
    except Exception as error:  # damaged headers fail in as many ways as there are libraries
        raise _damaged(shown, error) from error
    return replace(volume, slabs=_guarded(volume))


def is_volume(path: Path) -> bool:
    """Whether a name is that of a format of volumes alone, and no stack of images."""
    return is_zarr(path) or _reader(path.name) is not None or path.name.lower().endswith((".raw", ".vol"))


def _found(items: list[str | Path], folder: Path) -> VolumeFile:
    if len(items) == 1:
        item = str(items[0])
        name, _, inner = item.partition("::")
        found = _single(folder / Path(name).expanduser(), item, inner)
        if found is not None:
            return found
    others = [item for item in map(str, items) if _reader(item.partition("::")[0]) is not None]
    if others:
        raise InputError(others[0], "a volume of this format is one file", "give this file alone")
    try:
        stack = find_stack(items if len(items) > 1 else items[0], folder)
    except InputError as error:
        raise InputError(error.where, error.fact, error.remedy.replace(FORMATS, VOLUME_FORMATS)) from error
    parts = stack.parts
    if all(family(part.path) == TIFF for part in parts):
        volume = tiff_volume(stack.files, stack.spec)
    elif len(parts) == 1 and family(parts[0].path) == NPY:
        volume = npy_volume(parts[0].path, stack.spec)
    else:
        shape, dtype = stack.info()
        volume = VolumeFile(stack.spec, stack.files, shape, dtype, _stack_slabs(stack))
    return replace(volume, inner=tuple(part.inner for part in parts), notes=(*stack.notes, *volume.notes))


def _single(path: Path, item: str, inner: str) -> VolumeFile | None:
    """The volume in one file or store of a format that is no stack of images; None for others."""
    if is_zarr(path):
        return zarr_volume(path, item, inner)
    reader, raw = _reader(path.name), path.name.lower().endswith(RAW)
    if reader is None and not raw and family(path) != HDF5:
        return None
    if not path.is_file():
        files = locate(str(path), Path()).files
        if len(files) > 1:
            raise InputError(item, f"{len(files)} files match, each a volume", f'name one, as "{files[0].name}"')
        path = files[0]
    checked_file(path)
    if reader is not None:
        if inner:
            raise InputError(item, "'::' is for raw, HDF5 and Zarr files", "leave it out")
        return reader(path, item)
    if not raw:
        return hdf5_volume(path, item, inner)
    header = None if inner else _header_beside(path)
    described = None if header is None else _reader(header.name)
    if header is None or described is None:
        return raw_volume(path, item, inner)
    volume = described(header, item)
    if path.resolve() not in {file.resolve() for file in volume.files}:
        raise InputError(item, f"{header.name} beside it describes another file", f'give "{header.name}", or the sizes')
    return replace(volume, notes=(f"type and sizes are those of {header.name}", *volume.notes))


def _reader(name: str) -> Callable[[Path, str], VolumeFile] | None:
    """The reader of a format that has a header, by the name of a file."""
    return next((read for suffixes, read in _BY_HEADER.items() if name.lower().endswith(suffixes)), None)


def _guarded(volume: VolumeFile) -> Slabs:
    def slabs(bounds: Iterable[Bounds]) -> Iterator[Pixels]:
        try:
            yield from volume.slabs(bounds)
        except (InputError, MemoryError):
            raise
        except Exception as error:
            raise _damaged(volume.spec, error) from error

    return slabs


def _damaged(spec: str, error: Exception) -> InputError:
    fact = f"damaged, or of another format ({' '.join(str(error).split())})"
    return InputError(spec, fact, "copy or export the file again")


def _header_beside(path: Path) -> Path | None:
    """The header of a raw file: of the same name, with another suffix or one more."""
    for suffix in (".mhd", ".nhdr", ".vgi"):
        for candidate in (path.with_suffix(suffix), path.with_name(path.name + suffix)):
            if candidate.is_file():
                return candidate
    return None


def npy_volume(path: Path, spec: str) -> VolumeFile:
    """The array of a .npy file; one slice, if it has two axes."""
    array = load_npy(path, "r")
    array = array[None] if array.ndim == 2 else array
    order = volume_axes(array.shape, (), str(path))
    shape = (array.shape[order[0]], array.shape[order[1]], array.shape[order[2]])
    return VolumeFile(spec, (path,), shape, array.dtype, sliced(lambda: nullcontext(array), order, array.ndim))


def _stack_slabs(stack: Stack) -> Slabs:
    def slabs(bounds: Iterable[Bounds]) -> Iterator[Pixels]:
        for first, last in bounds:
            yield stack.read(np.arange(first, last))

    return slabs
