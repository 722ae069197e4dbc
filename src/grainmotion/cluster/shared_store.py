"""Shelf: large arrays on storage that all workers see, so that they load them and nobody sends them.

What is shelved is a pickle whose large arrays are files of their own; those laid end to end are one, and are so again
when they are taken.  A worker that takes it reads those; one that takes over from another that died reads them again.
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
from typing import Any

import numpy as np
from numpy.typing import NDArray

LARGE = 1 << 14
"""Bytes from which an array becomes a file."""


@dataclass(frozen=True)
class StoredObject:
    """Something on the shelf; small enough to be told to anybody."""

    folder: Path
    pickled: bytes

    def take(self) -> Any:
        """The thing itself, read from the shelf."""
        return _Taking(io.BytesIO(self.pickled), self.folder).load()


@dataclass(frozen=True)
class StoredImages:
    """An array on the shelf, as stacks of radiographs ``(…, rows, columns)``."""

    path: Path

    def rows(self, first: int, end: int) -> NDArray[Any]:
        """Some rows of all views."""
        return np.array(np.load(self.path, mmap_mode="r")[..., first:end, :])

    def all(self) -> NDArray[Any]:
        """All of it."""
        whole: NDArray[Any] = np.load(self.path)
        return whole


class SharedStore:
    """A folder for arrays, gone when it is closed."""

    def __init__(self, folder: Path) -> None:
        self._made = not folder.exists()
        folder.mkdir(parents=True, exist_ok=True)
        self.folder = Path(tempfile.mkdtemp(prefix=".shelf-", dir=folder.resolve()))
        self._known: dict[int, tuple[weakref.ref[NDArray[Any]], str]] = {}
        self._count = 0
        self.lasting: dict[object, Any] = {}
        """What is shared out for as long as what it was made of lives."""

    def put(self, thing: object) -> StoredObject:
        """Put something here; an array that is here already is not written again."""
        buffer = io.BytesIO()
        _Putting(buffer, self).dump(thing)
        return StoredObject(self.folder, buffer.getvalue())

    @contextmanager
    def lent(self, images: tuple[NDArray[Any], ...]) -> Iterator[list[StoredImages]]:
        """Stacks of radiographs, here for a moment."""
        paths = [self.folder / self.write(image) for image in images]
        try:
            yield [StoredImages(path) for path in paths]
        finally:
            _remove(paths)

    def kept_images(self, images: NDArray[Any]) -> StoredImages:
        """A stack of radiographs, here for as long as anybody in this process refers to it."""
        path = self.folder / self.write(images)
        kept = StoredImages(path)
        weakref.finalize(kept, _remove, [path])
        return kept

    def write(self, array: NDArray[Any]) -> str:
        """Write an array; the name of its file."""
        name = f"{self._count}.npy"
        self._count += 1
        np.save(self.folder / name, array)
        return name

    def name_of(self, array: NDArray[Any]) -> str:
        """The file of an array, written when it is first seen."""
        known = self._known.get(id(array))
        if known is None or known[0]() is not array:
            known = weakref.ref(array), self.write(array)
            self._known[id(array)] = known
        return known[1]

    def close(self) -> None:
        """Remove everything."""
        self.lasting.clear()
        shutil.rmtree(self.folder, ignore_errors=True)
        if self._made:
            with suppress(OSError):  # results are in it
                self.folder.parent.rmdir()


class _Putting(pickle.Pickler):
    def __init__(self, file: io.BytesIO, shelf: SharedStore) -> None:
        super().__init__(file, protocol=pickle.HIGHEST_PROTOCOL)
        self._shelf = shelf

    def persistent_id(self, obj: Any) -> tuple[str, int, tuple[int, ...]] | None:
        if type(obj) is not np.ndarray or obj.dtype.hasobject:
            return None
        whole, first, base = obj, 0, obj.base
        flat = type(base) is np.ndarray and base.ndim == 1 and base.dtype == obj.dtype
        if base is not None and flat and obj.flags.c_contiguous:  # one of many, end to end
            whole = base
            first = (obj.ctypes.data - whole.ctypes.data) // obj.itemsize
        return (self._shelf.name_of(whole), first, obj.shape) if whole.nbytes >= LARGE else None


class _Taking(pickle.Unpickler):
    def __init__(self, file: io.BytesIO, folder: Path) -> None:
        super().__init__(file)
        self._folder, self._read = folder, dict[str, NDArray[Any]]()

    def persistent_load(self, pid: tuple[str, int, tuple[int, ...]]) -> NDArray[Any]:
        name, first, shape = pid
        if name not in self._read:
            self._read[name] = np.load(self._folder / name)
        whole = self._read[name]
        if whole.shape == shape:
            return whole
        return whole[first : first + math.prod(shape)].reshape(shape)


def _remove(paths: list[Path]) -> None:
    for path in paths:
        path.unlink(missing_ok=True)
