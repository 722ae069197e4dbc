"""The memory that a run may use, and what it does if that is less than it needs."""

from __future__ import annotations

import ctypes
import logging
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import psutil

from grainmotion.cluster.connection import LOCAL, ComputeConfig
from grainmotion.experiment.inputs import Inputs
from grainmotion.experiment.inspection import peak_memory
from grainmotion.io.array_files import ArrayFiles
from grainmotion.model.large_arrays import large_arrays_in

USED_SHARE = 0.9
"""Share of the free memory that a run counts on: the estimate of what it needs may be too low, and others need some."""
_LOG = logging.getLogger("grainmotion")
_GROUP = Path("/sys/fs/cgroup")


def free_memory() -> float:
    """Bytes of memory that this process could have: what is free, up to the limit of its container."""
    free = float(psutil.virtual_memory().available)
    limit, used = (_number(_GROUP / name) for name in ("memory.max", "memory.current"))
    if limit is None or used is None:
        return free
    return max(0.0, min(free, limit - used + (_cached() or 0.0)))


def usable_memory(workplace: ComputeConfig) -> float:
    """Bytes that a process may use: as told, or most of what is free."""
    return USED_SHARE * free_memory() if workplace.bytes is None else workplace.bytes


def give_back_memory() -> None:
    """Give memory that was freed back to the system: the C library keeps that of arrays up to 32 MB for later ones."""
    trim = getattr(ctypes.CDLL(None), "malloc_trim", None) if os.name == "posix" else None  # of glibc alone
    if trim is not None:
        trim(ctypes.c_size_t(0))


@contextmanager
def memory_of_run(inputs: Inputs, folder: Path, workplace: ComputeConfig) -> Iterator[None]:
    """Keep radiographs, volumes and labels in files beside the results inside, if memory is too short for them.

    That is said at once.  Where workers compute, this process still holds radiographs, volume and labels, and may use
    what is free here; ``--memory`` is then of each worker.
    """
    here = LOCAL if workplace.is_cluster else workplace
    needed, usable = peak_memory(inputs), usable_memory(here)
    if needed <= usable:
        yield
        return
    place = next(path for path in (folder, *folder.absolute().parents) if path.is_dir())
    told = f"{usable / 1e9:.3g} GB are free" if here.bytes is None else f"{usable / 1e9:.3g} GB may be used"
    _LOG.warning(
        "memory: the run needs about %.3g GB and %s: radiographs, volumes and labels are kept in files in %s, "
        "which takes longer (larger voxels, or fewer of them, need less)",
        needed / 1e9, told, place,
    )  # fmt: skip
    with large_arrays_in(ArrayFiles(place)):
        yield


def _cached() -> float | None:
    """Bytes of files that the container keeps in memory and would give back."""
    try:
        lines = (_GROUP / "memory.stat").read_text().splitlines()
    except OSError:
        return None
    return next((float(line.split()[1]) for line in lines if line.startswith("inactive_file ")), None)


def _number(path: Path) -> float | None:
    """The number in a file of the system; None if there is none."""
    try:
        return float(path.read_text())
    except (OSError, ValueError):
        return None
