"""Radiographs, volumes and labels of a run: in memory, or wherever a run that lacks memory keeps them.

Whatever grows with the scan is made here.  `io.array_files` keeps such arrays in files where the memory is short.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar

import numpy as np
from numpy.typing import DTypeLike, NDArray

MAX_SMALL_ARRAY = 1 << 22
"""Bytes up to which an array is kept in memory in any case."""

Storage = Callable[[tuple[int, ...], DTypeLike], NDArray]
"""Makes an array of zeros of a shape and number type."""
_storage: ContextVar[Storage | None] = ContextVar("storage of large arrays", default=None)


@contextmanager
def large_arrays_in(storage: Storage | None) -> Iterator[None]:
    """Make large arrays by ``storage`` inside; in memory with None."""
    before = _storage.set(storage)
    try:
        yield
    finally:
        _storage.reset(before)


def large_empty(shape: tuple[int, ...], dtype: DTypeLike) -> NDArray:
    """An array whose values still have to be set."""
    storage = _storage_for(shape, dtype)
    return np.empty(shape, dtype) if storage is None else storage(shape, dtype)


def large_zeros(shape: tuple[int, ...], dtype: DTypeLike) -> NDArray:
    """An array of zeros, which takes memory as its values are set."""
    storage = _storage_for(shape, dtype)
    return np.zeros(shape, dtype) if storage is None else storage(shape, dtype)


def large_copy(array: NDArray) -> NDArray:
    """A copy of an array."""
    out = large_empty(array.shape, array.dtype)
    out[...] = array
    return out


def _storage_for(shape: tuple[int, ...], dtype: DTypeLike) -> Storage | None:
    """Where to make an array that is not small; None for memory."""
    large = int(np.prod(shape, dtype=np.int64)) * np.dtype(dtype).itemsize > MAX_SMALL_ARRAY
    return _storage.get() if large else None
