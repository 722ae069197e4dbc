"""HDF5: one dataset of a file, and NXtomo files (NeXus) by h5py alone."""

from __future__ import annotations

import difflib
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import h5py
import hdf5plugin  # noqa: F401  its filters are known to h5py from here on: blosc, bitshuffle, LZ4, zstd
import numpy as np

from grainmotion._typing import Float, Index, Pixels
from grainmotion.errors import InputError
from grainmotion.io.angles import in_degrees
from grainmotion.io.files import checked_file
from grainmotion.io.hdf5_numbers import unit_of
from grainmotion.io.hdf5_slabs import read_whole
from grainmotion.io.hdf5_sources import check_link, check_sources, check_written
from grainmotion.io.nxtomo_records import Record, read_records
from grainmotion.model.progress import counted

MAX_NAMES_IN_AN_ERROR = 8
PROJECTION, FLAT, DARK = 0, 1, 2  # NXtomo's image_key; 3 is an invalid frame


@contextmanager
def opened(path: str | Path) -> Iterator[h5py.File]:
    """An HDF5 file open for reading; any failure of HDF5 becomes an `InputError` that names the file."""
    path = checked_file(path)
    try:
        with h5py.File(path, "r") as file:
            yield file
    except (OSError, RuntimeError, KeyError) as error:
        fact = "truncated or damaged HDF5" if "truncated" in str(error) else "not a readable HDF5 file"
        if "filter" in str(error):
            fact = "compressed by a filter that is not installed"
        if "lock" in str(error).lower().replace("sblock", ""):  # a superblock is no lock
            remedy = "close the program that writes it, or copy the file"
            raise InputError(str(path), "another program has it open for writing", remedy) from error
        raise InputError(str(path), f"{fact} ({error.args[0]})", "copy or export the file again") from error


def dataset_info(path: str | Path, inner: str) -> tuple[tuple[int, ...], np.dtype]:
    """Shape and type of the dataset ``inner`` of an HDF5 file."""
    with opened(path) as file:
        data = dataset_in(file, path, inner)
        return tuple(data.shape), data.dtype


def read_dataset(path: str | Path, inner: str, chosen: Index | None = None) -> Pixels:
    """The dataset ``inner`` of an HDF5 file, or the items ``chosen`` along its first axis."""
    with opened(path) as file:
        data = dataset_in(file, path, inner)
        check_written(data, chosen)
        return read_whole(data) if chosen is None else np.stack([data[int(k)] for k in counted(chosen)])


def read_angles_deg(path: str | Path, inner: str) -> Float:
    """A dataset of angles, in degrees by its attribute ``units``; without it they are taken for degrees."""
    with opened(path) as file:
        data = dataset_in(file, path, inner)
        values = np.asarray(data[()])
        if values.dtype.kind not in "iuf":
            raise InputError(f"{path}::{inner}", f"it holds {data.dtype}, no numbers", "name a dataset of angles")
        return in_degrees(values.astype(float).ravel(), unit_of(data), f"{path}::{inner}")


@dataclass(frozen=True, eq=False)
class NXtomo:
    """The frames of an NXtomo file, located but not read yet."""

    path: Path
    data: str  # path of the frames' dataset in the file
    keys: Index  # (frames,): 0 projection, 1 flat, 2 dark; frames of any other key are not used
    angles_deg: Float  # (frames,): rotation angles; NaN if the file has none
    shape: tuple[int, int]  # rows and columns of a frame
    dtype: np.dtype
    records: tuple[Record, ...] = ()  # of beam, stage and detector

    @property
    def entry(self) -> str:
        """Path of the NXtomo entry in the file."""
        return self.data.removesuffix("/instrument/detector/data")

    @property
    def projection_angles_deg(self) -> Float:
        """Rotation angle of each projection, degrees."""
        return self.angles_deg[self.keys == PROJECTION]

    def count(self, key: int) -> int:
        """Number of frames of one kind."""
        return int((self.keys == key).sum())

    def read(self, key: int, chosen: Index | None = None) -> Pixels:
        """Frames of one kind, ``(frames, rows, columns)``: all in the file's order, or the ``chosen`` in theirs."""
        rows = np.flatnonzero(self.keys == key)
        rows = rows if chosen is None else rows[chosen]
        frames = np.empty((len(rows), *self.shape), self.dtype)
        with opened(self.path) as file:
            data = dataset_in(file, self.path, self.data)
            check_written(data, rows)
            for frame, row in counted(zip(frames, rows), len(rows)):
                frame[...] = data[row]
        return frames


def read_nxtomo(path: str | Path) -> NXtomo:
    """Locate frames, image keys and angles in an NXtomo file.

    The first group with ``instrument/detector`` that holds ``data`` and ``image_key`` is taken, as in
    ``entry/instrument/detector`` or ``entry1/tomo_entry/instrument/detector``.  Frames that
    ``image_key_control`` marks as alignment frames (−1) are not used.
    """
    with opened(path) as file:
        for group in _groups(file):
            check_link(file, f"{group}/instrument/detector/data")
        entries = nxtomo_entries(file)
        if not entries:
            fact = "no NXtomo entry with instrument/detector/data and image_key, and no group exchange"
            stacks = [name for name, shape in dataset_shapes(file).items() if len(shape) == 3]
            inside = f"; it holds {', '.join(stacks[:MAX_NAMES_IN_AN_ERROR])}" if stacks else ""
            example = stacks[0] if stacks else "/path/to/data"
            raise InputError(str(path), fact + inside, f'name one dataset in it as "{Path(path).name}::{example}"')
        found = entries[0]
        entry = file[found]
        detector = entry["instrument/detector"]
        data = detector["data"]
        keys = np.asarray(detector["image_key"][()]).astype(np.int64).ravel()
        control = detector.get("image_key_control")
        if control is not None and control.shape == keys.shape:
            keys = np.where(np.asarray(control[()]) == -1, 3, keys)
        if data.ndim != 3 or len(keys) != len(data):
            fact = f"frames {data.shape} and {len(keys)} image keys do not match"
            raise InputError(str(path), fact, "give one image_key a frame")
        return NXtomo(
            path=Path(path),
            data=f"{found}/instrument/detector/data",
            keys=keys,
            angles_deg=_angles_deg(entry, len(keys)),
            shape=(int(data.shape[1]), int(data.shape[2])),
            dtype=data.dtype,
            records=read_records(entry, len(keys)),
        )


def nxtomo_entries(file: h5py.File) -> list[str]:
    """Paths of the groups that hold ``instrument/detector`` with frames and keys."""
    needed = ("instrument/detector/data", "instrument/detector/image_key")
    return [path for path, group in _groups(file).items() if all(n in group for n in needed)]


def _groups(file: h5py.File) -> dict[str, h5py.Group]:
    """The groups of the two upper levels by their paths in this file, behind links too."""
    upper = {f"/{name}": file[name] for name in file if isinstance(file.get(name), h5py.Group)}
    lower = {f"{path}/{n}": g[n] for path, g in upper.items() for n in g if isinstance(g.get(n), h5py.Group)}
    return {**upper, **lower}


def _angles_deg(entry: h5py.Group, frames: int) -> Float:
    """``sample/rotation_angle`` in degrees, whatever its unit."""
    angles = entry.get("sample/rotation_angle")
    if angles is None:
        return np.full(frames, np.nan)
    values = np.asarray(angles[()], dtype=float).ravel()
    if len(values) != frames:
        fact = f"{len(values)} rotation angles for {frames} frames"
        raise InputError(str(entry.file.filename), fact, "give one rotation_angle a frame")
    return in_degrees(values, unit_of(angles), f"{entry.file.filename}::{angles.name}")


def dataset_in(file: h5py.File, path: str | Path, inner: str) -> h5py.Dataset:
    """A dataset by its path, with all its sources; else an error that names what is like it."""
    check_link(file, inner)
    data = file.get(inner)
    if isinstance(data, h5py.Dataset):
        check_sources(data)
        return data
    shapes = dataset_shapes(file)
    if isinstance(data, h5py.Group):
        within = [name for name in shapes if name.startswith(data.name.rstrip("/") + "/")]
        held = [f"{name} {shapes[name]}" for name in within[:MAX_NAMES_IN_AN_ERROR]]
        raise InputError(
            str(path), f"'{inner}' is a group", f"name a dataset in it: {', '.join(held) or 'it is empty'}"
        )
    near = difflib.get_close_matches("/" + inner.strip("/"), shapes, n=1, cutoff=0.6)
    hint = f"did you mean '{near[0]}'? " if near else ""
    names = ", ".join(list(shapes)[:MAX_NAMES_IN_AN_ERROR])
    raise InputError(str(path), f"no dataset '{inner}'", f"{hint}it holds {names or 'no dataset'}")


def dataset_shapes(file: h5py.File) -> dict[str, tuple[int, ...]]:
    """Shapes of all datasets of a file by their paths."""
    shapes: dict[str, tuple[int, ...]] = {}

    def note(name: str, item: object) -> None:
        if isinstance(item, h5py.Dataset):
            shapes[f"/{name}"] = item.shape

    file.visititems(note)
    return shapes
