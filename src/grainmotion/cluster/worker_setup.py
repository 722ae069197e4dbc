"""Worker plugin that sets the number of threads and registers the sizes of our records.

Without the sizes Dask counts records as empty, and neither spills nor places them well.
"""

from __future__ import annotations

import ctypes
import os
import signal
import threading
from dataclasses import fields
from typing import TYPE_CHECKING

from grainmotion.cluster.reconstruction_tasks import SlabState
from grainmotion.cluster.tracking_tasks import ImageStrip, ProjectedPatches, Rays
from grainmotion.cluster.worker_threads import limit_threads
from grainmotion.model.compact_volume import CompactVolume
from grainmotion.model.geometry import Geometry
from grainmotion.model.grains import Grain
from grainmotion.model.scan import Scan
from grainmotion.model.volume import Volume
from grainmotion.projection.volume_operator import VolumeOperator
from grainmotion.reconstruction.slabs import RadiographRows, Slab, Strip
from grainmotion.reconstruction.system import Imaging

if TYPE_CHECKING:
    from _typeshed import DataclassInstance
    from distributed import Client, Worker

SIZED_RECORDS = (
    Geometry,
    Imaging,
    SlabState,
    Scan,
    RadiographRows,
    Slab,
    Rays,
    Strip,
    ImageStrip,
    Volume,
    CompactVolume,
    Grain,
    VolumeOperator,
    ProjectedPatches,
)


MEMORY_OPTIONS = {-1: 64 << 20, -3: 32 << 20}
"""glibc's M_TRIM_THRESHOLD and M_MMAP_THRESHOLD (bytes), at what they grow to by themselves where they are not set."""


def register() -> None:
    """Register the sizes with Dask in this process."""
    from dask.sizeof import sizeof

    def size(record: DataclassInstance) -> int:
        return sum(int(sizeof(getattr(record, field.name))) for field in fields(record))

    for kind in SIZED_RECORDS:
        sizeof.register(kind, size)


def keep_freed_memory() -> None:
    """Let the C library keep the memory of freed arrays for later ones, as it does in a process of its own.

    Dask starts workers with a setting that gives it back at every free: a state of 76 grains took 12 CPU s instead of
    8, as the system clears each page that it hands out anew.
    """
    set_option = getattr(ctypes.CDLL(None), "mallopt", None) if os.name == "posix" else None  # of glibc alone
    if set_option is not None:
        for option, size in MEMORY_OPTIONS.items():
            set_option(ctypes.c_int(option), ctypes.c_int(size))


def prepare_workers(client: Client, *, ours: bool) -> None:
    """Let all workers, also those to come, know the sizes of records and their number of threads.

    ``ours`` is whether they are processes of this command: Ctrl-C then reaches them too, and is left to the command,
    which ends them.
    """
    from distributed import WorkerPlugin

    class Ready(WorkerPlugin):
        name = "grainmotion-ready"

        def setup(self, worker: Worker) -> None:
            register()
            limit_threads(worker.state.nthreads)
            keep_freed_memory()
            if ours and threading.current_thread() is threading.main_thread():
                signal.signal(signal.SIGINT, signal.SIG_IGN)

    client.register_plugin(Ready())
