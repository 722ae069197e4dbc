"""SharedStore: large arrays in files that all workers see, so that they load them and nobody sends them.

A stored object is a pickle whose large arrays are files of their own; arrays that lie end to end share one, and lie so
again when the object is loaded.  A worker that takes over from a lost one reads the files again.
"""

from __future__ import annotations

import io
import math
import pickle
import shutil
import tempfile
import weakref
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from grainmotion._typing import Image

T = TypeVar("T")

MIN_FILE_BYTES = 1 << 14
"""Bytes from which an array becomes a file."""


@dataclass(frozen=True)
class StoredObject(Generic[T]):
    """Handle to a stored object; cheap to pickle."""

    folder: Path
    pickled: bytes

    def load(self) -> T:
        """The object, read from the store."""
        loaded: T = _Unpickler(io.BytesIO(self.pickled), self.folder).load()
        return loaded


@dataclass(frozen=True)
class StoredImages:
    """Handle to stored radiographs ``(…, rows, columns)``."""

    path: Path

    def rows(self, first: int, end: int) -> Image:
        """Some rows of all views."""
        return np.array(np.load(self.path, mmap_mode="r")[..., first:end, :])

    def all(self) -> Image:
        """All rows."""
        whole: Image = np.load(self.path)
        return whole


class SharedStore:
    """A folder for arrays, removed when it is closed.

    A store within another one is in the other's folder, and takes the files of arrays that the other one keeps.
    """

    def __init__(self, folder: Path, outer: SharedStore | None = None) -> None:
        self._made, self._outer = not folder.exists(), outer
        folder.mkdir(parents=True, exist_ok=True)
        self.folder = Path(tempfile.mkdtemp(prefix=".shelf-", dir=folder.resolve()))
        self._kept: dict[int, tuple[weakref.ref[NDArray[np.generic]], str]] = {}
        self._known: dict[int, tuple[weakref.ref[NDArray[np.generic]], str]] = {}
        self._count = 0
        self.shared: dict[object, object] = {}
        """What is distributed to workers, by keys that are dropped with the arrays that it was made of."""

    def put(self, thing: T) -> StoredObject[T]:
        """Store an object; an array that is stored already is not written again."""
        buffer = io.BytesIO()
        _Pickler(buffer, self).dump(thing)
        return StoredObject(self.folder, buffer.getvalue())

    def within(self) -> SharedStore:
        """A store for a shorter time; what is put there must not outlive the arrays of which this one keeps files."""
        return SharedStore(self.folder, self)

    def keep(self, array: NDArray[np.generic]) -> StoredImages:
        """An array, stored for as long as this process refers to it: stores within this one do not write it again."""
        name = _name_in(self._kept, array)
        if name is None:
            name = self.write(array)
            self._kept[id(array)] = weakref.ref(array), name
            weakref.finalize(array, _remove, [self.folder / name])
        return StoredImages(self.folder / name)

    @contextmanager
    def temporary(self, images: tuple[NDArray[np.generic], ...]) -> Iterator[list[StoredImages]]:
        """Stacks of radiographs, stored within the context."""
        paths = [self.folder / self.write(image) for image in images]
        try:
            yield [StoredImages(path) for path in paths]
        finally:
            _remove(paths)

    def store_images(self, images: NDArray[np.generic]) -> StoredImages:
        """A stack of radiographs, stored for as long as this process refers to its handle."""
        path = self.folder / self.write(images)
        stored = StoredImages(path)
        weakref.finalize(stored, _remove, [path])
        return stored

    def write(self, array: NDArray[np.generic]) -> str:
        """Write an array; the name of its file."""
        name = f"{self._count}.npy"
        self._count += 1
        np.save(self.folder / name, array)
        return name

    def name_of(self, array: NDArray[np.generic]) -> str:
        """The file of an array, written the first time."""
        name = _name_in(self._known, array)
        if name is None:
            name = self.write(array)
            self._known[id(array)] = weakref.ref(array), name
        return name

    def name_in_outer(self, array: NDArray[np.generic]) -> str | None:
        """The file of an array that the store around this one keeps; None if it keeps none."""
        name = None if self._outer is None else _name_in(self._outer._kept, array)
        return None if name is None else f"../{name}"

    def close(self) -> None:
        """Remove everything."""
        self.shared.clear()
        shutil.rmtree(self.folder, ignore_errors=True)
        if self._made:
            with suppress(OSError):  # results are in it
                self.folder.parent.rmdir()


class _Pickler(pickle.Pickler):
    def __init__(self, file: io.BytesIO, store: SharedStore) -> None:
        super().__init__(file, protocol=pickle.HIGHEST_PROTOCOL)
        self._store = store

    def persistent_id(self, obj: object) -> tuple[str, int, tuple[int, ...]] | None:
        if type(obj) is not np.ndarray or obj.dtype.hasobject:
            return None
        name = self._store.name_in_outer(obj)
        if name is not None:
            return name, 0, obj.shape
        whole, first, base = obj, 0, obj.base
        flat = type(base) is np.ndarray and base.ndim == 1 and base.dtype == obj.dtype
        if base is not None and flat and obj.flags.c_contiguous:  # one of many, end to end
            whole = base
            first = (obj.ctypes.data - whole.ctypes.data) // obj.itemsize
        return (self._store.name_of(whole), first, obj.shape) if whole.nbytes >= MIN_FILE_BYTES else None


class _Unpickler(pickle.Unpickler):
    def __init__(self, file: io.BytesIO, folder: Path) -> None:
        super().__init__(file)
        self._folder, self._read = folder, dict[str, NDArray[np.generic]]()

    def persistent_load(self, pid: tuple[str, int, tuple[int, ...]]) -> NDArray[np.generic]:
        name, first, shape = pid
        if name not in self._read:
            self._read[name] = np.load(self._folder / name)
        whole = self._read[name]
        if whole.shape == shape:
            return whole
        return whole[first : first + math.prod(shape)].reshape(shape)


def _name_in(files: dict[int, tuple[weakref.ref[NDArray[np.generic]], str]], array: NDArray[np.generic]) -> str | None:
    """The file of an array; an id alone may be that of an array that is gone."""
    known = files.get(id(array))
    return known[1] if known is not None and known[0]() is array else None


def _remove(paths: list[Path]) -> None:
    for path in paths:
        path.unlink(missing_ok=True)
