"""What ends a command before its end: one record for the line on the terminal, the JSON document and the exit code."""

from __future__ import annotations

import errno
import os
import tempfile
import traceback
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from typing import Literal

from grainmotion.cli.exit_codes import BAD_INPUT, FAULT
from grainmotion.cli.interrupts import CONTINUE, INTERRUPTED, Stop
from grainmotion.errors import ALSO, LOG_NOTE, BackendError, GrainmotionError

FULL_DISK = (errno.ENOSPC, errno.EDQUOT)
"""Errors of a disk, or a share of it, that is full; writing files tells them as a `WriteError`."""
Kind = Literal["usage", "input", "device", "memory", "interrupted", "fault"]


@dataclass(frozen=True)
class Failure:
    """Why a command ended, and what to do."""

    kind: Kind
    code: int
    where: str
    fact: str
    remedy: str
    log: Path | None = None

    @property
    def line(self) -> str:
        """One line for standard error; where several errors are told, one for each."""
        if self.kind == "interrupted":
            return INTERRUPTED
        sentence = f"{self.where}: {self.fact}" if self.where else self.fact
        more = f"; {self.remedy}" if self.remedy else ""
        log = f" (log: {self.log})" if self.log is not None and self.kind != "fault" else ""
        told = f"error: {sentence}{more}{log}".split(ALSO)
        return ALSO.join(" ".join(one.split()) for one in told)


def failure(error: BaseException, stop: Stop) -> Failure:
    """What an exception that ended a command means to its user."""
    log = log_of(error)
    if stop.signal is not None or isinstance(error, KeyboardInterrupt):
        return Failure("interrupted", stop.code, "", "interrupted", CONTINUE, log)
    if isinstance(error, GrainmotionError):
        kind: Kind = "device" if isinstance(error, BackendError) else "input"
        return Failure(kind, BAD_INPUT, error.where, error.fact, error.remedy, log)
    if isinstance(error, MemoryError):
        fact = str(error) or "not enough of it"
        return Failure("memory", FAULT, "memory", fact, "give larger voxels or fewer of them", log)
    if isinstance(error, OSError) and error.errno in FULL_DISK and error.filename is None:
        fact = "cannot be written: no space left on the disk"
        return Failure("input", BAD_INPUT, "standard output", fact, "make room, then go on", log)
    return _fault(error, log)


def _fault(error: BaseException, log: Path | None) -> Failure:
    """A fault of the program: its traceback is in the log of the run, or in a file of its own."""
    if log is None:
        handle, name = tempfile.mkstemp(prefix="grainmotion-fault-", suffix=".log")
        with os.fdopen(handle, "w", encoding="utf-8") as file:
            file.writelines(traceback.format_exception(error))
        log = Path(name)
    fact = f"a fault of grainmotion, not of your input ({type(error).__name__}: {error})"
    remedy = f"please report it to {where_to_report()} with the file {log}, which has the details"
    return Failure("fault", FAULT, "", " ".join(fact.split()), remedy, log)


def where_to_report() -> str:
    """The page of issues that the package's metadata name, else its authors."""
    urls = metadata.metadata("grainmotion").get_all("Project-URL") or []
    pages = dict(url.split(", ", 1) for url in urls)
    issues = [page for name, page in pages.items() if name.lower() in ("issues", "bug tracker", "tracker")]
    return issues[0] if issues else "the authors of grainmotion (named in CITATION.cff)"


def log_of(error: BaseException) -> Path | None:
    """The log file that tells more about an error, if there is one."""
    notes = [note for note in getattr(error, "__notes__", ()) if note.startswith(LOG_NOTE)]
    return Path(notes[-1].removeprefix(LOG_NOTE)) if notes else None
