"""Threads of a simulated block: one shared array for all, common steps, and errors that are not lost."""

import os
import subprocess
import sys

SHARED_ARRAY = """
import threading, time
import numpy as np
from numba.cuda.simulator import kernelapi
from gpu.simulated_blocks import mend_simulator
if {mend}:
    mend_simulator()
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
STEPS = """
import time
import numpy as np
from numba import cuda
from gpu.simulated_blocks import mend_simulator
mend_simulator()

@cuda.jit
def steps(order, ended):
    shared, thread = cuda.shared.array(8, np.int64), cuda.threadIdx.x
    if thread == 7:
        return  # the others do not wait for it
    time.sleep(0.01 * thread)
    shared[thread] = thread
    cuda.syncthreads()
    if thread == 6:
        return
    order[thread] = shared[6 - thread]  # written by a thread that was slower or faster
    cuda.syncthreads()
    ended[thread] = order[5 - thread]

order, ended = np.zeros(8, np.int64), np.zeros(8, np.int64)
steps[1, 8](order, ended)
print(*order, "then", *ended)

@cuda.jit
def fails(out):
    if cuda.threadIdx.x == 3:
        raise ValueError("of one thread")
    cuda.syncthreads()
    out[cuda.threadIdx.x] = 1

out = np.zeros(8)
try:
    fails[2, 8](out)
except ValueError as error:
    print(error, out.any())
"""


def printed(code):
    environment = {**os.environ, "NUMBA_ENABLE_CUDASIM": "1", "PYTHONPATH": os.pathsep.join(p for p in sys.path if p)}
    command = [sys.executable, "-c", code]
    return subprocess.run(command, env=environment, capture_output=True, text=True, check=True, timeout=100).stdout


def test_one_array_for_all_threads():
    assert printed(SHARED_ARRAY.format(mend=True)) == "1 (3, 2)\n"


def test_the_simulator_alone_makes_several():
    arrays = printed(SHARED_ARRAY.format(mend=False)).split()[0]
    assert int(arrays) > 1  # once it does not, the mend is to be removed


def test_threads_pass_a_barrier_together_and_an_error_ends_the_block():
    steps, error = printed(STEPS).splitlines()
    assert steps == "6 5 4 3 2 1 0 0 then 1 2 3 4 5 6 0 0"
    assert error == "tid=[3, 0, 0] ctaid=[0, 0, 0]: of one thread False"
