"""What every format needs: checks of paths before reading and writing, and atomic writes."""

from __future__ import annotations

import errno
import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from grainmotion.errors import InputError, WriteError

_BEING_WRITTEN: set[Path] = set()  # files and folders that are being written


def remove_unfinished() -> None:
    """Remove what is half written, before the process is ended from outside the code that writes it."""
    for path in tuple(_BEING_WRITTEN):
        if path.is_dir():
            shutil.rmtree(path, ignore_errors=True)
        else:
            path.unlink(missing_ok=True)


def checked_file(path: str | Path) -> Path:
    """The path, if it is a readable file that is not empty; else an `InputError` that names it."""
    path = Path(path)
    if path.is_dir():
        raise InputError(str(path), "it is a folder", "name the file in it")
    if not path.is_file():
        if path.exists():
            raise InputError(str(path), "it is a device or a pipe, and no file", "name a file on a disk")
        raise InputError(str(path), "no such file", "check the path; paths start at the experiment file's folder")
    if path.stat().st_size == 0:
        raise InputError(str(path), "the file is empty (0 bytes)", "copy it again from the source")
    if not os.access(path, os.R_OK):
        raise InputError(str(path), "no permission to read it", "change its permissions")
    return path


def checked_folder(path: str | Path) -> Path:
    """The path, if it is a folder with permission to write or one can be created there; it is not created yet."""
    path = Path(path)
    existing = next(p for p in (path, *path.absolute().parents) if p.exists())
    if not existing.is_dir():
        raise InputError(str(path), f"{existing} is a file", "choose a folder for the results")
    if not os.access(existing, os.W_OK | os.X_OK):
        raise InputError(str(path), f"no permission to write in {existing}", "choose another folder for the results")
    return path


@contextmanager
def atomic_write(path: str | Path) -> Iterator[Path]:
    """A temporary path beside ``path``, which replaces it when the block succeeds and is removed when it fails.

    So an interrupted run neither leaves half a file nor damages an older one.  Raises a `WriteError` if the disk is
    full, or the folder cannot be written to.
    """
    path = Path(path)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, name = tempfile.mkstemp(prefix=f".{path.stem}-", suffix=path.suffix, dir=path.parent)
    except OSError as error:
        raise _not_written(path, error) from error
    os.close(handle)
    temporary = Path(name)
    _BEING_WRITTEN.add(temporary)
    try:
        with _written(path, temporary):
            yield temporary
        mask = os.umask(0)  # the only way to read it is to set it
        os.umask(mask)
        temporary.chmod(0o666 & ~mask)
        try:
            os.replace(temporary, path)
        except OSError as error:
            fact = f"cannot be replaced: {error.strerror}"
            raise WriteError(str(path), fact, "choose another file") from error
    finally:
        temporary.unlink(missing_ok=True)
        _BEING_WRITTEN.discard(temporary)


@contextmanager
def _written(path: Path, temporary: Path) -> Iterator[None]:
    """Tell an error of the system while a file is written; one that names another file is passed on."""
    try:
        yield
    except OSError as error:
        if error.filename is not None and not Path(os.fsdecode(error.filename)).is_relative_to(temporary):
            raise
        raise _not_written(path, error) from error


def _not_written(path: Path, error: OSError) -> WriteError:
    """The error about a file that cannot be written: libraries tell a full disk in several ways."""
    reason = " ".join((error.strerror or str(error)).split())
    full = error.errno in (errno.ENOSPC, errno.EDQUOT) or reason.endswith("written")  # as tifffile counts bytes
    if full:
        return WriteError(str(path), "cannot be written: no space left on the disk", "make room, then go on")
    return WriteError(str(path), f"cannot be written: {reason}", "choose a folder that you may write to")


@contextmanager
def atomic_folder(path: str | Path) -> Iterator[Path]:
    """A temporary folder beside ``path``, which replaces it, an older one included, when the block succeeds."""
    path = Path(path)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        temporary = Path(tempfile.mkdtemp(prefix=f".{path.stem}-", dir=path.parent))
    except OSError as error:
        raise _not_written(path, error) from error
    _BEING_WRITTEN.add(temporary)
    try:
        new = temporary / "new"
        with _written(path, temporary):
            new.mkdir()
            yield new
        try:
            if path.exists():
                os.replace(path, temporary / "old")
            os.replace(new, path)
        except OSError as error:
            fact = f"cannot be replaced: {error.strerror}"
            raise WriteError(str(path), fact, "choose another folder") from error
    finally:
        shutil.rmtree(temporary, ignore_errors=True)
        _BEING_WRITTEN.discard(temporary)
