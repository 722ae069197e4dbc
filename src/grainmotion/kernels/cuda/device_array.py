"""Arrays that lie on the card, and the shapes of blocks of threads."""

from __future__ import annotations

import warnings
from contextlib import contextmanager
from functools import cached_property

import numpy as np
from numba import config, cuda
from numba.core.errors import NumbaPerformanceWarning

warnings.filterwarnings("ignore", "Grid size .* low occupancy", NumbaPerformanceWarning)  # small samples are no fault

SIMULATED = bool(config.ENABLE_CUDASIM)
TILE = (2, 2) if SIMULATED else (16, 8)
"""Threads along the columns and rows of a block: a warp's rays stay close, and there is a Python thread each
where they are simulated."""
THREADS = TILE[0] * TILE[1]
MOST = 1 if SIMULATED else 32768
"""Blocks along an axis, where threads take further elements in turn."""

SQUARE = 32
"""Pixels across the squares of a panel that a block fills from the patches that reach into it."""


class DeviceArray:
    """An array on the card; indices and numpy's functions see its copy on the host, made when first asked for."""

    def __init__(self, array):
        self.array = array

    @property
    def dtype(self):
        """Type of the elements."""
        return self.array.dtype

    @property
    def shape(self):
        """Lengths of the axes."""
        return tuple(self.array.shape)

    def __len__(self):
        return self.shape[0]

    @cached_property
    def host(self):
        """The same numbers on the host; `changed` says that they are so no more."""
        return self.array.copy_to_host()

    def changed(self):
        """Forget the copy on the host, after a kernel wrote to the array."""
        self.__dict__.pop("host", None)

    def __array__(self, dtype=None, copy=None):
        return self.host.astype(dtype or self.dtype, copy=bool(copy))

    def __getitem__(self, index):
        return self.host[index]

    def copy(self):
        """Another array on the card with the same numbers."""
        out = empty(self.shape, self.dtype)
        out.array.copy_to_device(self.array)
        return out


def on_card(array):
    """The device array of what is held, or of a host array's fresh copy."""
    if isinstance(array, DeviceArray):
        return array.array
    array = np.ascontiguousarray(array)
    with _room(array.nbytes):
        return cuda.to_device(array)


def hold(array):
    """Copy a host array to the card, to stay there."""
    return DeviceArray(on_card(array))


def empty(shape, dtype):
    """An array on the card, not set."""
    with _room(int(np.prod(shape)) * np.dtype(dtype).itemsize):
        return DeviceArray(cuda.device_array(shape, dtype))


def zeros(shape, dtype):
    """An array of zeros on the card."""
    out = empty(shape, dtype)
    size = int(np.prod(shape))
    if size:
        _fill[min(-(-size // THREADS), MOST), THREADS](out.array.reshape(size), 0)
    return out


def bring(array, out):
    """Copy a device array into the host's ``out``."""
    if out.size:
        array.copy_to_host(out)


@contextmanager
def _room(wanted):
    """Name a card that is full as Python names a full memory."""
    try:
        yield
    except Exception as error:
        if "OUT_OF_MEMORY" not in str(error):
            raise
        raise MemoryError(f"the card has no room for another {wanted / 1e9:.2f} GB") from error


@cuda.jit
def _fill(array, value):
    for i in range(cuda.grid(1), len(array), cuda.gridsize(1)):
        array[i] = value


def squares(shape):
    """Blocks for images ``(n, rows, columns)``, one a square."""
    return -(-shape[2] // SQUARE), -(-shape[1] // SQUARE), shape[0]


def try_card():
    """Run a kernel; whatever keeps it from running is raised."""
    zeros((THREADS,), np.float32).host.sum()
