"""Large arrays in mapped files, for runs that lack memory.

The system keeps as much of a mapped file in memory as is free, writes the rest to the disk, and reads it again when it
is used; programs see an array as usual.  The files have no name: nothing is left of one when its array is no longer
used, or when the process ends in whatever way.
"""

from __future__ import annotations

import os
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import DTypeLike, NDArray

from grainmotion.errors import InputError


@dataclass(frozen=True)
class ArrayFiles:
    """Makes arrays (a `model.large_arrays.Storage`) in files of a folder."""

    folder: Path

    def __call__(self, shape: tuple[int, ...], dtype: DTypeLike) -> NDArray:
        """An array of zeros in a file of its own.

        Raises
        ------
        InputError
            If the disk has no room for it.
        """
        size = int(np.prod(shape, dtype=np.int64)) * np.dtype(dtype).itemsize
        try:
            with tempfile.TemporaryFile(dir=self.folder) as file:
                _reserve(file.fileno(), size)
                return np.asarray(np.memmap(file, np.dtype(dtype), "r+", shape=shape))
        except OSError as error:
            fact = f"no room for a file of {size / 1e9:.3g} GB, which the memory does not hold ({error.strerror})"
            remedy = "free some of the disk, or write the results to a larger one with --out"
            raise InputError(str(self.folder), fact, remedy) from error


def _reserve(file: int, size: int) -> None:
    """Take the space now: a page that finds no space later ends the process without a word."""
    if hasattr(os, "posix_fallocate"):
        os.posix_fallocate(file, 0, size)
    else:
        os.truncate(file, size)
