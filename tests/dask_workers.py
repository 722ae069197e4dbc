"""A Dask scheduler of the tests' own, and worker processes that they start and kill."""

import os
import signal
import subprocess
import sys
from contextlib import contextmanager

import pytest

distributed = pytest.importorskip("distributed")


class Workers:
    """Worker processes without a nanny that would restart them."""

    def __init__(self, address):
        self.address, self.processes = address, []

    def start(self, memory="2GB"):
        command = [sys.executable, "-m", "distributed.cli.dask_worker", self.address, "--no-nanny", "--no-dashboard"]
        command += ["--nthreads", "1", "--memory-limit", memory]
        self.processes.append(subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL))
        return self

    def kill(self):
        """Kill the oldest worker, as a crash would."""
        os.kill(self.processes.pop(0).pid, signal.SIGKILL)


@contextmanager
def scheduler():
    """A scheduler without workers, and the means to start and kill some."""
    with distributed.LocalCluster(n_workers=0, dashboard_address=None, silence_logs="CRITICAL") as local:
        workers = Workers(local.scheduler_address)
        try:
            yield workers
        finally:
            for process in workers.processes:
                process.kill()
