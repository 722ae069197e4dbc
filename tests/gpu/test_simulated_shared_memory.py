"""Threads of a simulated block get one shared array, even if all ask for it at the same time."""

import os
import subprocess
import sys

CODE = """
import threading, time
import numpy as np
from numba.cuda.simulator import kernelapi
from gpu.simulated_shared_memory import allocate_once
if {mend}:
    allocate_once()
make = np.empty
def slow(*arguments):
    time.sleep(0.01)  # long enough for all threads to have found no array
    return make(*arguments)
np.empty = slow
shared, arrays, start = kernelapi.FakeCUDAShared(0), [], threading.Barrier(8)
def thread():
    start.wait()
    arrays.append(shared.array((3, 2), np.float64))
threads = [threading.Thread(target=thread) for _ in range(8)]
for t in threads: t.start()
for t in threads: t.join()
print(len({{id(a) for a in arrays}}), arrays[0].shape)
"""


def arrays_of_a_block(mend):
    environment = {**os.environ, "NUMBA_ENABLE_CUDASIM": "1", "PYTHONPATH": os.pathsep.join(p for p in sys.path if p)}
    command = [sys.executable, "-c", CODE.format(mend=mend)]
    return subprocess.run(command, env=environment, capture_output=True, text=True, check=True).stdout.split(maxsplit=1)


def test_one_array_for_all_threads():
    assert arrays_of_a_block(mend=True) == ["1", "(3, 2)\n"]


def test_the_simulator_alone_makes_several():
    assert int(arrays_of_a_block(mend=False)[0]) > 1  # once it does not, the mend is to be removed
