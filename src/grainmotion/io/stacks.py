"""Image stacks by a specification: TIFF or PNG files, ``.npy``, ``"file.h5::/path"``, one NXtomo file, Zeiss's files.

A specification is a path, a folder, a glob or a list of those.  Files of a glob or folder are taken in the order of the
numbers in their names (``proj_2`` before ``proj_10``), those of a list in the order given.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Literal

import numpy as np

from grainmotion._typing import Index, Pixels
from grainmotion.errors import InputError
from grainmotion.io import hdf5, png, tiff, txrm
from grainmotion.io.formats import FORMATS, HDF5, PNG, TIFF, TXRM, check_npy, family, unreadable
from grainmotion.io.locate import locate
from grainmotion.model.large_arrays import large_empty
from grainmotion.model.progress import counted


@dataclass(frozen=True)
class Part:
    """One file of a stack: all of it, its dataset ``inner``, or its NXtomo frames of one ``key``."""

    path: Path
    inner: str | None = None
    key: int | None = None


@dataclass(frozen=True)
class Stack:
    """Images whose files are located, but not read yet; headers are read once, when they are first asked for."""

    spec: str  # as the user wrote it, for messages
    parts: tuple[Part, ...]  # the files, in order
    series: bool = False  # whether a pattern or folder gave them, so that their names tell something
    notes: tuple[str, ...] = ()  # what was done to find them, where it is not obvious

    @property
    def files(self) -> tuple[Path, ...]:
        """Paths of the files."""
        return tuple(p.path for p in self.parts)

    @cached_property
    def nxtomo(self) -> hdf5.NXtomo | None:
        """The NXtomo file, if the stack is one."""
        single = len(self.parts) == 1 and self.parts[0].key is not None
        return hdf5.read_nxtomo(self.parts[0].path) if single else None

    @cached_property
    def _infos(self) -> list[tuple[tuple[int, int, int], np.dtype]]:
        """Shape (images, rows, columns) and type of each part."""
        return [_info(part, self.nxtomo) for part in counted(self.parts)]

    def frames(self, key: int) -> Stack:
        """The flats or darks of the same NXtomo file."""
        stack = Stack(self.spec, (Part(self.parts[0].path, key=key),))
        stack.__dict__["nxtomo"] = self.nxtomo  # read already
        return stack

    def info(self) -> tuple[tuple[int, int, int], np.dtype]:
        """Shape (images, rows, columns) and type, from the files' headers."""
        infos = self._infos
        self._check_sizes([shape for shape, _ in infos])
        for part, (_, dtype) in zip(self.parts, infos):
            if dtype.kind not in "buif":
                raise InputError(str(part.path), f"its pixels are {dtype}, no real numbers", "give counts as numbers")
        count = sum(shape[0] for shape, _ in infos)
        rows, columns = infos[0][0][1:]
        return (count, rows, columns), np.result_type(*{dtype for _, dtype in infos})

    def read(self, chosen: Index | None = None) -> Pixels:
        """The pixels ``(images, rows, columns)`` of all or of the chosen images, in the type of the files."""
        if chosen is not None:
            return self._read_chosen(chosen)
        if len(self.parts) == 1:
            images = _read(self.parts[0], self.nxtomo)
            self._check_sizes([images.shape])
            return images
        shape, dtype = self.info()
        images, first = large_empty(shape, dtype), 0  # each file goes to its place, so that no two copies are held
        for part, (expected, _) in counted(zip(self.parts, self._infos, strict=True), len(self.parts)):
            array = _read(part, self.nxtomo)
            if array.shape != expected:
                fact = f"it holds {array.shape} (images, rows, columns), and held {expected} a moment ago"
                raise InputError(str(part.path), fact, "wait until it is written, and start again")
            images[first : first + len(array)] = array
            first += len(array)
        return images

    def _read_chosen(self, chosen: Index) -> Pixels:
        """Read only the files that hold a chosen image; of .npy and HDF5, only those images."""
        owners = np.searchsorted(self._ends, chosen, side="right")
        arrays, order = [], []
        for k in counted(np.unique(owners)):
            members = np.flatnonzero(owners == k)
            start = self._ends[k - 1] if k > 0 else 0
            arrays.append(_read(self.parts[k], self.nxtomo, chosen[members] - start))
            order.append(members)
        self._check_sizes([a.shape for a in arrays])
        if len(arrays) == 1:
            return arrays[0]
        images = np.empty((len(chosen), *arrays[0].shape[1:]), np.result_type(*arrays))
        for members, array in zip(order, arrays, strict=True):
            images[members] = array
        return images

    @cached_property
    def _ends(self) -> Index:
        """Number of images up to the end of each part."""
        return np.cumsum([shape[0] for shape, _ in self._infos])

    def _check_sizes(self, shapes: Sequence[tuple[int, ...]]) -> None:
        if sum(shape[0] for shape in shapes) == 0:
            raise InputError(self.spec, "it holds no image", FORMATS)
        for part, shape in zip(self.parts, shapes):
            if shape[1:] != shapes[0][1:]:
                fact = f"{shape[1:]} pixels, but {self.parts[0].path.name} has {shapes[0][1:]}"
                remedy = "give images of one size; leave previews and images of other scans out"
                raise InputError(str(part.path), fact, remedy)


def find_stack(spec: str | Path | Sequence[str | Path], folder: str | Path = ".") -> Stack:
    """Locate the files of a specification, whose relative paths start at ``folder``; pixels are not read."""
    items = [spec] if isinstance(spec, str | Path) else list(spec)
    if not items:
        raise InputError("list of files", "it is empty", FORMATS)
    found = [_parts(str(item), Path(folder)) for item in items]
    return Stack(
        str(spec) if isinstance(spec, str | Path) else f"{items[0]} ...",
        tuple(part for stack in found for part in stack.parts),
        len(found) == 1 and found[0].series,
        tuple(note for stack in found for note in stack.notes),
    )


def _parts(item: str, folder: Path) -> Stack:
    """The files of one path, folder or pattern."""
    name, _, inner = item.partition("::")
    located = locate(name, folder)
    parts = []
    for path in located.files:
        formats = family(path)
        if inner and formats not in (HDF5, TXRM):
            raise InputError(item, "'::' names a dataset of an HDF5 file", FORMATS)
        if formats is None:
            raise unreadable(path)
        key = hdf5.PROJECTION if formats == HDF5 and not inner else None
        parts.append(Part(path, inner or None, key))
    return Stack(item, tuple(parts), located.series, (located.note,) if located.note else ())


def _info(part: Part, nxtomo: hdf5.NXtomo | None) -> tuple[tuple[int, int, int], np.dtype]:
    formats = family(part.path)
    if formats == TIFF:
        return tiff.tiff_info(part.path)
    if formats == PNG:
        return png.png_info(part.path)
    if formats == TXRM:
        return txrm.txrm_info(part.path, part.inner)
    if part.key is not None:
        file = nxtomo or hdf5.read_nxtomo(part.path)
        return (file.count(part.key), *file.shape), file.dtype
    if part.inner is not None:
        shape, dtype = hdf5.dataset_info(part.path, part.inner)
    else:
        array = load_npy(part.path, "r")
        shape, dtype = array.shape, array.dtype
    return _stack_shape(part, shape), dtype


def _read(part: Part, nxtomo: hdf5.NXtomo | None, images: Index | None = None) -> Pixels:
    """All images of a part, or some of them; of .npy and HDF5 no others are read."""
    if part.key is not None:
        return (nxtomo or hdf5.read_nxtomo(part.path)).read(part.key, images)
    if family(part.path) == TXRM:
        return txrm.read_txrm(part.path, part.inner, images)
    if family(part.path) == TIFF:
        array = tiff.read_tiff(part.path)
    elif family(part.path) == PNG:
        array = png.read_png(part.path)
    elif part.inner is None:
        array = load_npy(part.path, None if images is None else "r")
    elif images is not None and len(hdf5.dataset_info(part.path, part.inner)[0]) == 3:
        return hdf5.read_dataset(part.path, part.inner, images)
    else:
        array = hdf5.read_dataset(part.path, part.inner)
    array = array.reshape(_stack_shape(part, array.shape))
    return array if images is None else np.asarray(array[images])


def _stack_shape(part: Part, shape: tuple[int, ...]) -> tuple[int, int, int]:
    if len(shape) == 2:
        return 1, shape[0], shape[1]
    if len(shape) != 3:
        where = str(part.path) if part.inner is None else f"{part.path}::{part.inner}"
        raise InputError(where, f"an array of shape {shape} is no stack", "give (images, rows, columns)")
    return shape[0], shape[1], shape[2]


def load_npy(path: Path, mode: Literal["r"] | None) -> Pixels:
    """The array of a .npy file, mapped or in memory."""
    check_npy(path)
    try:
        array: Pixels = np.load(path, mmap_mode=mode, allow_pickle=False)
    except (ValueError, EOFError, OSError) as error:
        fact = f"truncated or damaged .npy ({error})"
        raise InputError(str(path), fact, "save it again with numpy.save") from error
    return array
