"""Spare: memory of arrays that nobody holds any more, for the next ones of their size.

A task must not change what it is given, so each update copies its slab.  Pages that the system has to clear first
cost several times as much as the copying.
"""

from __future__ import annotations

import weakref
from typing import Any

import numpy as np
from numpy.typing import NDArray

MOST = 4
"""Pieces of memory that are kept: what an update of two slabs copies."""

_KEPT: list[NDArray[np.uint8]] = []


class _Lent:
    """Owner of an array and, through it, of all views of that."""

    def __init__(self, memory: NDArray[np.uint8], like: NDArray[Any]) -> None:
        place = memory.__array_interface__["data"]
        self.__array_interface__ = {"shape": like.shape, "typestr": like.dtype.str, "data": place, "version": 3}
        weakref.finalize(self, _back, memory).atexit = False


def copied(array: NDArray[Any]) -> NDArray[Any]:
    """A copy, in C order, whose memory serves another one as soon as nobody refers to it or to a view of it."""
    found = np.asarray(_Lent(_taken(array.nbytes), array))
    np.copyto(found, array)
    return found


def _taken(size: int) -> NDArray[np.uint8]:
    for k, memory in enumerate(_KEPT):
        if size <= memory.size <= 1.25 * size:
            return _KEPT.pop(k)
    return np.empty(size, np.uint8)


def _back(memory: NDArray[np.uint8]) -> None:
    _KEPT.append(memory)
    del _KEPT[:-MOST]
