"""Arrays in the memory of the GPU, and the shapes of blocks of threads."""

from __future__ import annotations

import warnings
from contextlib import contextmanager
from functools import cached_property

import numpy as np
from numba import config, cuda
from numba.core.errors import NumbaPerformanceWarning

warnings.filterwarnings("ignore", "Grid size .* low occupancy", NumbaPerformanceWarning)  # expected with small samples

SIMULATED = bool(config.ENABLE_CUDASIM)
TILE = (2, 2) if SIMULATED else (16, 8)
"""Threads along the columns and rows of a block: a warp's rays stay close, and there is a Python thread each
where they are simulated."""
THREADS = TILE[0] * TILE[1]
MAX_BLOCKS = 1 if SIMULATED else 32768
"""Blocks along an axis, where threads take further elements in turn."""

SQUARE_PIXELS = 32
"""Pixels across the squares of a detector that a block fills from the patches that reach into it."""


class DeviceArray:
    """An array in GPU memory; indexing and numpy functions use its copy on the host, made at the first access."""

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
        """The copy on the host; `changed` drops it."""
        return self.array.copy_to_host()

    def changed(self):
        """Drop the copy on the host, after a kernel wrote to the array."""
        self.__dict__.pop("host", None)

    def __array__(self, dtype=None, copy=None):
        return self.host.astype(dtype or self.dtype, copy=bool(copy))

    def __getitem__(self, index):
        return self.host[index]

    def copy(self):
        """A copy in GPU memory."""
        out = empty(self.shape, self.dtype)
        out.array.copy_to_device(self.array)
        return out


def on_gpu(array):
    """numba's array of a `DeviceArray`, or of a new copy of a host array."""
    if isinstance(array, DeviceArray):
        return array.array
    array = np.ascontiguousarray(array)
    with _room(array.nbytes):
        return cuda.to_device(array)


def upload(array):
    """Copy a host array to the GPU, to stay there."""
    return DeviceArray(on_gpu(array))


def empty(shape, dtype):
    """An uninitialised array on the GPU."""
    with _room(int(np.prod(shape)) * np.dtype(dtype).itemsize):
        return DeviceArray(cuda.device_array(shape, dtype))


def zeros(shape, dtype):
    """An array of zeros on the GPU."""
    out = empty(shape, dtype)
    size = int(np.prod(shape))
    if size:
        _fill[min(-(-size // THREADS), MAX_BLOCKS), THREADS](out.array.reshape(size), 0)
    return out


def download(array, out):
    """Copy a device array into the host's ``out``."""
    if out.size:
        array.copy_to_host(out)


@contextmanager
def _room(wanted):
    """Turn the driver's out-of-memory error into a MemoryError."""
    try:
        yield
    except Exception as error:
        if "OUT_OF_MEMORY" not in str(error):
            raise
        raise MemoryError(f"the GPU has no room for another {wanted / 1e9:.2f} GB") from error


@cuda.jit
def _fill(array, value):
    for i in range(cuda.grid(1), len(array), cuda.gridsize(1)):
        array[i] = value


def square_grid(shape):
    """Blocks for images ``(n, rows, columns)``, one a square."""
    return -(-shape[2] // SQUARE_PIXELS), -(-shape[1] // SQUARE_PIXELS), shape[0]


def run_test_kernel():
    """Run a kernel; raise what keeps it from running."""
    zeros((THREADS,), np.float32).host.sum()
