"""Threads of kernels in a worker: as many as it was given; and compiling never fails for them."""

import os
import subprocess
import sys

import pytest

LATE = """
import os, sys
import numba, numpy as np
from grainmotion.cluster.worker_threads import use_worker_threads, limit_threads

@numba.njit(parallel=True)
def kernel(a):
    for k in numba.prange(len(a)):
        a[k] += 1

started, told = sys.argv[1] == "True", int(sys.argv[2])
if started:
    kernel(np.zeros(100))
os.environ["NUMBA_NUM_THREADS"] = str(told)  # as Dask does, once numba is there
limit_threads(told)
with use_worker_threads():
    kernel(np.zeros(100, np.float32))  # compiles again
print(numba.config.NUMBA_NUM_THREADS)
"""


@pytest.mark.parametrize(("started", "told", "threads"), [(True, 1, 2), (False, 1, 1), (True, 3, 2), (False, 3, 2)])
def test_compiling_and_walking_go_on(started, told, threads):
    """A worker whose numba was imported, and perhaps used, with 2 threads before it knew how many it is to have."""
    environment = {k: v for k, v in os.environ.items() if not k.startswith("NUMBA_")} | {"NUMBA_NUM_THREADS": "2"}
    command = [sys.executable, "-c", LATE, str(started), str(told)]
    found = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert found.returncode == 0, found.stderr
    assert int(found.stdout) == threads
