"""Parts of an HDF5 dataset that lie in other files, or were never written: HDF5 reads them as zeros without a word."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import h5py
import numpy as np

from grainmotion._typing import Index
from grainmotion.errors import InputError

_COPY_SOURCES = "copy the files that it refers to beside it, with their relative paths"
MAX_NAMES = 4


def check_link(file: h5py.File, inner: str) -> None:
    """Refuse a path through an external link whose file is missing, naming that file."""
    place = ""
    for part in inner.strip("/").split("/"):
        place += f"/{part}"
        link = file.get(place, getlink=True)
        if isinstance(link, h5py.ExternalLink):
            target = _resolved(file, link.filename)
            if not target.is_file():
                fact = f"'{place}' is a link to {link.filename}, which is not there"
                raise InputError(str(file.filename), fact, _COPY_SOURCES)
        if link is None:
            return


def check_sources(data: h5py.Dataset) -> None:
    """Refuse a virtual dataset, or one with its bytes in other files, of which a file or dataset is missing."""
    missing: list[str] = []
    if data.is_virtual:
        for name, inner in sorted({(s.file_name, s.dset_name) for s in data.virtual_sources()}):
            missing += _missing_source(data, name, inner)
    for name, _, _ in data.external or ():
        if not _resolved(data.file, str(name)).is_file():
            missing.append(str(name))
    if missing:
        shown = ", ".join(missing[:MAX_NAMES]) + (", ..." if len(missing) > MAX_NAMES else "")
        fact = f"the images of '{data.name}' lie in other files, of which {len(missing)} are missing: {shown}"
        raise InputError(str(data.file.filename), fact, f"{_COPY_SOURCES}; HDF5 would read zeros instead")


def check_written(data: h5py.Dataset, items: Index | None = None) -> None:
    """Refuse items along the first axis, all or the chosen ones, that were never written."""
    unwritten = _unwritten(data)
    unwritten = unwritten if items is None else np.intersect1d(unwritten, items)
    if len(unwritten):
        fact = f"images {_ranges(unwritten)} of '{data.name}' were never written"
        remedy = "the scan was stopped, or the file not completely written: leave them out with the key views"
        raise InputError(str(data.file.filename), fact, remedy)


def _missing_source(data: h5py.Dataset, name: str, inner: str) -> list[str]:
    """What of a source of a virtual dataset is missing: nothing, the file, or the dataset in it."""
    if name == ".":
        return [] if inner in data.file else [f"dataset {inner}"]
    if "%b" in name:  # numbered by HDF5 itself: any number of files
        found = _resolved(data.file, name).parent
        return [] if any(found.glob(Path(name).name.replace("%b", "*"))) else [name]
    path = _resolved(data.file, name)
    if not path.is_file():
        return [name]
    try:
        with h5py.File(path, "r") as source:
            return [] if "%b" in inner or inner in source else [f"{name}::{inner}"]
    except OSError:
        return [f"{name} (damaged)"]


def _resolved(file: h5py.File, name: str) -> Path:
    """Where HDF5 looks for another file: beside the file that refers to it, else from the working directory."""
    beside = Path(file.filename).parent / name
    return beside if beside.exists() or not Path(name).exists() else Path(name)


def _unwritten(data: h5py.Dataset) -> Index:
    """Items along the first axis of which no part was ever written."""
    if data.is_virtual or data.external or data.ndim < 3 or data.size == 0:
        return np.zeros(0, dtype=int)
    if data.chunks is None:
        return np.arange(len(data) if data.id.get_storage_size() == 0 else 0)
    first = [-(-n // c) for n, c in zip(data.shape, data.chunks)]
    if data.id.get_num_chunks() >= np.prod(first):
        return np.zeros(0, dtype=int)
    written = np.zeros(first[0], dtype=bool)

    def note(chunk: h5py.h5d.StoreInfo) -> None:
        written[chunk.chunk_offset[0] // data.chunks[0]] = True

    data.id.chunk_iter(note)
    return np.flatnonzero(~np.repeat(written, data.chunks[0])[: len(data)])


def _ranges(numbers: Sequence[int] | Index) -> str:
    """Numbers as ranges: "0, 40 to 59"."""
    pieces = np.split(np.asarray(numbers), np.flatnonzero(np.diff(numbers) > 1) + 1)
    words = [f"{p[0]}" if len(p) == 1 else f"{p[0]} to {p[-1]}" for p in pieces]
    return ", ".join(words[:MAX_NAMES]) + (", ..." if len(words) > MAX_NAMES else "")
