"""Kernels in a worker use as many threads as it was given, and can still be compiled."""

import os
import subprocess
import sys

import pytest

PROGRAM = """
import os, sys
import numba, numpy as np
from grainmotion.cluster.worker_threads import use_worker_threads, limit_threads

@numba.njit(parallel=True)
def kernel(a):
    for k in numba.prange(len(a)):
        a[k] += 1

started, given = sys.argv[1] == "True", int(sys.argv[2])
if started:
    kernel(np.zeros(100))
os.environ["NUMBA_NUM_THREADS"] = str(given)  # as Dask does, after numba was imported
limit_threads(given)
with use_worker_threads():
    kernel(np.zeros(100, np.float32))  # compiles again
print(numba.config.NUMBA_NUM_THREADS)
"""


@pytest.mark.parametrize(("started", "given", "threads"), [(True, 1, 2), (False, 1, 1), (True, 3, 2), (False, 3, 2)])
def test_kernels_run_and_compile_after_the_limit_is_set(started, given, threads):
    """Numba was imported, and perhaps used, with 2 threads before the worker got its own limit."""
    environment = {k: v for k, v in os.environ.items() if not k.startswith("NUMBA_")} | {"NUMBA_NUM_THREADS": "2"}
    command = [sys.executable, "-c", PROGRAM, str(started), str(given)]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert int(done.stdout) == threads
