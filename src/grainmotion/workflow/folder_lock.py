"""One process at a time writes results into a folder: what it knows of finished stages is then what is there."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from filelock import FileLock, Timeout

from grainmotion.errors import InputError
from grainmotion.workflow.provenance import StageCache

LOCK_FILE = ".lock"
"""Beside the results while a run or a watch goes on; the system frees it when the process ends in whatever way."""


@contextmanager
def only_process(folder: Path, cache: StageCache) -> Iterator[None]:
    """Hold a results folder, and read again which stages are done; raises an `InputError` if another process holds it.

    A folder that cannot be written to, or is on a drive that knows no locks, is not held.
    """
    lock = FileLock(folder / LOCK_FILE, timeout=0)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        lock.acquire()
    except Timeout:
        fact = "another run or watch is writing its results here"
        raise InputError(str(folder), fact, "wait until it ends, or choose another folder with --out") from None
    except (OSError, NotImplementedError):
        yield
        return
    try:
        cache.read()
        yield
    finally:
        with suppress(OSError):  # where open files cannot be removed it stays, which does no harm
            (folder / LOCK_FILE).unlink(missing_ok=True)
        lock.release()
