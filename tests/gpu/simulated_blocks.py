"""Blocks of threads in numba's CUDA simulator: shared memory that is allocated once, and waiting without polling.

The simulator runs the threads of a block as threads of Python and lets two of them allocate the same shared array at
the same time: each looks for it, finds none, and makes its own, so that the numbers of one are lost and unwritten
memory is added up instead (`FakeCUDAShared.array` of numba-cuda 0.30).  That was seen once, on a
busy machine.  A GPU has one array by construction.

It also polls: the thread that launches a kernel asks all threads of the block in a loop whether they are done, and
takes the interpreter from them meanwhile.  Here it sleeps until one of them ends or reaches ``syncthreads``.
"""

from __future__ import annotations

import sys
import threading
from types import SimpleNamespace

import numpy as np

_LOCK = threading.Lock()


def mend_simulator() -> None:
    """Let the simulator make a shared array once a block, and wait for the threads of a block without polling."""
    from numba.cuda.simulator.kernel import BlockManager
    from numba.cuda.simulator.kernelapi import FakeCUDAShared

    FakeCUDAShared.array = _shared_array
    BlockManager.run = _run_block


def _shared_array(self, shape, dtype, alignment=None):
    """Look for a shared array and make it in one step."""
    from numba import types
    from numba.np.numpy_support import as_dtype

    frame = sys._getframe(1)  # the simulator, too, tells arrays apart by the line that asks for them
    key = frame.f_code.co_filename, frame.f_lineno
    with _LOCK:
        if key not in self._allocations:
            self._allocations[key] = np.empty(shape, as_dtype(dtype) if isinstance(dtype, types.Type) else dtype)
        return self._allocations[key]


def _run_block(manager, grid_point, *arguments) -> None:
    """Run all threads of a block; those that have not ended pass ``syncthreads`` together."""
    from numba.cuda.simulator.kernel import BlockThread

    changed = threading.Condition()
    points = list(np.ndindex(*manager._block_dim))
    block = SimpleNamespace(running=len(points), waiting=0, releases=0, failed=[])

    def release_if_all_wait():
        if block.waiting == block.running or block.failed:
            block.waiting, block.releases = 0, block.releases + 1
            changed.notify_all()

    class Thread(BlockThread):
        def syncthreads(self):
            with changed:
                block.waiting, before = block.waiting + 1, block.releases
                release_if_all_wait()
                changed.wait_for(lambda: block.releases > before)
                if block.failed:
                    raise RuntimeError("another thread of the block failed")

        def run(self):
            super().run()  # keeps an exception
            with changed:
                block.running -= 1
                block.failed += [self.exception] if self.exception else []  # the first is the cause
                release_if_all_wait()

    threads = [Thread(lambda: manager._f(*arguments), manager, grid_point, p, manager._debug) for p in points]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    if block.failed:
        exception, traceback = block.failed[0]
        raise exception.with_traceback(traceback)
