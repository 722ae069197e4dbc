"""Shared memory of numba's CUDA simulator, allocated once a block however its threads are scheduled.

The simulator runs the threads of a block as threads of Python and lets two of them allocate the same shared array at
the same time: each looks for it, finds none, and makes its own, so that the numbers of one are lost and unwritten
memory is added up instead (`FakeCUDAShared.array` of numba-cuda 0.30).  That was seen once, on a
busy machine.  A GPU has one array by construction.
"""

from __future__ import annotations

import sys
import threading

import numpy as np

_LOCK = threading.Lock()


def allocate_once() -> None:
    """Let the simulator look for a shared array and make it in one step."""
    from numba import types
    from numba.cuda.simulator.kernelapi import FakeCUDAShared
    from numba.np.numpy_support import as_dtype

    def array(self, shape, dtype, alignment=None):
        frame = sys._getframe(1)  # the simulator, too, tells arrays apart by the line that asks for them
        key = frame.f_code.co_filename, frame.f_lineno
        with _LOCK:
            if key not in self._allocations:
                self._allocations[key] = np.empty(shape, as_dtype(dtype) if isinstance(dtype, types.Type) else dtype)
            return self._allocations[key]

    FakeCUDAShared.array = array
