"""Volumes by a specification of the experiment file: the format by the file's name, and its reader."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType

import numpy as np

from grainmotion._typing import Pixels
from grainmotion.errors import InputError
from grainmotion.io.files import checked_file
from grainmotion.io.formats import HDF5, TIFF, family
from grainmotion.io.locate import locate
from grainmotion.io.stacks import Stack, find_stack
from grainmotion.io.volumes.amira import AMIRA, amira_volume
from grainmotion.io.volumes.hdf5_volume import hdf5_volume
from grainmotion.io.volumes.metaimage import META_IMAGE, metaimage_volume
from grainmotion.io.volumes.nifti import NIFTI, nifti_volume
from grainmotion.io.volumes.nrrd import NRRD, nrrd_volume
from grainmotion.io.volumes.raw import RAW, raw_volume
from grainmotion.io.volumes.record import Bounds, Slabs, VolumeFile
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
    if len(items) == 1:
        spec = items[0]
        item = str(items[0])
        name, _, inner = item.partition("::")
        path = Path(folder) / Path(name).expanduser()
        found = _single(path, item, inner)
        if found is not None:
            return found
    stack = find_stack(spec, folder)
    parts = stack.parts
    if all(family(part.path) == TIFF for part in parts):
        volume = tiff_volume(stack.files, stack.spec)
    else:
        shape, dtype = stack.info()
        volume = VolumeFile(stack.spec, stack.files, shape, dtype, _stack_slabs(stack))
    return replace(volume, inner=tuple(part.inner for part in parts), notes=(*stack.notes, *volume.notes))


def _single(path: Path, item: str, inner: str) -> VolumeFile | None:
    """The volume in one file or store of a format that is no stack of images; None for others."""
    name = path.name.lower()
    if is_zarr(path):
        return zarr_volume(path, item, inner)
    reader = next((read for suffixes, read in _BY_HEADER.items() if name.endswith(suffixes)), None)
    raw = name.endswith(RAW)
    if reader is None and not raw and family(path) != HDF5:
        return None
    path = locate(str(path), Path()).files[0] if not path.is_file() else checked_file(path)
    if reader is not None:
        if inner:
            raise InputError(item, "'::' is for raw, HDF5 and Zarr files", "leave it out")
        return reader(path, item)
    if not raw:
        return hdf5_volume(path, item, inner)
    header = None if inner else _header_beside(path)
    if header is None:
        return raw_volume(path, item, inner)
    described = next(read for suffixes, read in _BY_HEADER.items() if header.name.lower().endswith(suffixes))
    volume = described(header, item)
    if path.resolve() not in {file.resolve() for file in volume.files}:
        raise InputError(item, f"{header.name} beside it describes another file", f'give "{header.name}", or the sizes')
    return replace(volume, notes=(f"type and sizes are those of {header.name}", *volume.notes))


def _header_beside(path: Path) -> Path | None:
    """The header of a raw file: of the same name, with another suffix or one more."""
    for suffix in (".mhd", ".nhdr", ".vgi"):
        for candidate in (path.with_suffix(suffix), path.with_name(path.name + suffix)):
            if candidate.is_file():
                return candidate
    return None


def _stack_slabs(stack: Stack) -> Slabs:
    def slabs(bounds: Iterable[Bounds]) -> Iterator[Pixels]:
        for first, last in bounds:
            yield stack.read(np.arange(first, last))

    return slabs
