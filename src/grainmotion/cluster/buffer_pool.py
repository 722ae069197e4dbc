"""Buffer pool: the memory of arrays that are no longer referred to is used again for arrays of their size.

A task must not change its arguments, so each update copies its slab.  New pages, which the operating system clears
first, would cost several times as much as the copying.
"""

from __future__ import annotations

import weakref

import numpy as np
from numpy.typing import NDArray

from grainmotion._typing import Image

MAX_FREE_BUFFERS = 4
"""Free buffers that are kept: as many as an update of two slabs copies."""

_FREE: list[NDArray[np.uint8]] = []


class _Loan:
    """Owner of an array and, through it, of all its views."""

    def __init__(self, memory: NDArray[np.uint8], like: Image) -> None:
        place = memory.__array_interface__["data"]
        self.__array_interface__ = {"shape": like.shape, "typestr": like.dtype.str, "data": place, "version": 3}
        weakref.finalize(self, _release, memory).atexit = False


def pooled_copy(array: Image) -> Image:
    """A copy, in C order, whose memory is free again once nothing refers to the copy or to a view of it."""
    copy = np.asarray(_Loan(_buffer_of(array.nbytes), array))
    np.copyto(copy, array)
    return copy


def _buffer_of(size: int) -> NDArray[np.uint8]:
    for k, memory in enumerate(_FREE):
        if size <= memory.size <= 1.25 * size:
            return _FREE.pop(k)
    return np.empty(size, np.uint8)


def _release(memory: NDArray[np.uint8]) -> None:
    _FREE.append(memory)
    del _FREE[:-MAX_FREE_BUFFERS]
