"""What every format needs: a file that is there to be read; a file written whole or not at all."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from grainmotion.errors import InputError


def checked_file(path: str | Path) -> Path:
    """The path, if it is a file that can be read and is not empty; else an `InputError` that names it."""
    path = Path(path)
    if path.is_dir():
        raise InputError(str(path), "it is a folder", "name the file in it")
    if not path.is_file():
        raise InputError(str(path), "no such file", "check the path; paths start at the experiment file's folder")
    if path.stat().st_size == 0:
        raise InputError(str(path), "the file is empty (0 bytes)", "copy it again from the source")
    if not os.access(path, os.R_OK):
        raise InputError(str(path), "no permission to read it", "change its permissions")
    return path


def checked_folder(path: str | Path) -> Path:
    """The path, if it is a folder, or can become one, that may be written to; nothing is made yet."""
    path = Path(path)
    there = next(p for p in (path, *path.absolute().parents) if p.exists())
    if not there.is_dir():
        raise InputError(str(path), f"{there} is a file", "choose a folder for the results")
    if not os.access(there, os.W_OK | os.X_OK):
        raise InputError(str(path), f"no permission to write in {there}", "choose another folder for the results")
    return path


@contextmanager
def atomic_write(path: str | Path) -> Iterator[Path]:
    """A temporary path beside ``path``, put in its place when the block ends well and removed when not."""
    path = Path(path)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, name = tempfile.mkstemp(prefix=f".{path.stem}-", suffix=path.suffix, dir=path.parent)
    except OSError as error:
        fact = f"cannot be written: {error.strerror}"
        raise InputError(str(path), fact, "choose a folder that you may write to") from error
    os.close(handle)
    temporary = Path(name)
    try:
        yield temporary
        temporary.chmod(0o666 & ~_umask())
        os.replace(temporary, path)
    finally:
        temporary.unlink(missing_ok=True)


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask
