"""Threads of kernels in a worker: as many as it was given; and compiling never fails for them."""

import os
import subprocess
import sys

import pytest

LATE = """
import os, sys
import numba, numpy as np
from grainmotion.cluster.threads import settle

@numba.njit(parallel=True)
def kernel(a):
    for k in numba.prange(len(a)):
        a[k] += 1

started, told = sys.argv[1] == "True", int(sys.argv[2])
if started:
    kernel(np.zeros(100))
os.environ["NUMBA_NUM_THREADS"] = str(told)  # as Dask does, once numba is there
settle(told)
kernel(np.zeros(100, np.float32))  # compiles again
print(numba.config.NUMBA_NUM_THREADS)
"""


@pytest.mark.parametrize("started", [True, False])
def test_threads_that_have_started_stay(started):
    """A worker whose numba was imported, and perhaps used, before it knew how many threads it has."""
    environment = {k: v for k, v in os.environ.items() if not k.startswith("NUMBA_")} | {"NUMBA_DISABLE_JIT": "0"}
    here = subprocess.run(
        [sys.executable, "-c", "import numba; print(numba.config.NUMBA_NUM_THREADS)"],
        env=environment, capture_output=True, text=True, check=True,
    )  # fmt: skip
    most = int(here.stdout)
    command = [sys.executable, "-c", LATE, str(started), str(most + 1)]
    found = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert found.returncode == 0, found.stderr
    assert int(found.stdout) == (most if started else most + 1)
