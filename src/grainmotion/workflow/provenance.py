"""Provenance: which stages of a run are done, and from what they were made.

A stage's fingerprint is a hash of its settings, of the content of its input files and of the
fingerprints of the stages before it.  ``stages.json`` keeps one fingerprint a finished stage; a stage
is struck out before its files are written and entered after, so that a killed run leaves no stage
that looks finished and is not.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Generic, TypeVar

from grainmotion.io.files import atomic_write

STAGES_FILE = "stages.json"
_HASH_BLOCK = 1 << 22  # bytes of a file hashed at a time
T = TypeVar("T")


@dataclass(frozen=True, eq=False)
class Stage(Generic[T]):
    """One step of a run, whose result lies in files.

    Attributes
    ----------
    name : str
        As in ``stages.json``.
    fingerprint : str
        Hash of all that it is made from.
    files : list of Path
        What ``write`` writes.
    run : callable
        Does the work and returns its result.
    write : callable
        Writes a result to the files.
    load : callable
        Reads the result back from the files.
    """

    name: str
    fingerprint: str
    files: list[Path]
    run: Callable[[], T]
    write: Callable[[T], object]
    load: Callable[[], T]


class StageCache:
    """The finished stages of the results in one folder."""

    def __init__(self, folder: str | Path) -> None:
        self.folder = Path(folder)
        self._stages: dict[str, tuple[str, list[str]]] = {}
        self._hashes: dict[str, tuple[int, int, str]] = {}
        try:
            kept = json.loads((self.folder / STAGES_FILE).read_text())
            self._stages = {n: (str(s["fingerprint"]), list(s["files"])) for n, s in kept["stages"].items()}
            self._hashes = {name: (int(s), int(t), str(h)) for name, (s, t, h) in kept["inputs"].items()}
        except (OSError, ValueError, KeyError, TypeError, AttributeError):
            self._stages, self._hashes = {}, {}  # none, or none that can be read: every stage is done again

    def fingerprint(self, settings: object, files: Iterable[Path] = (), upstream: Iterable[str] = ()) -> str:
        """Hash of what a stage is made from; ``settings`` must be plain data, as JSON holds it."""
        contents = [self._content(Path(f)) for f in files]
        made_from = [version("grainmotion"), settings, contents, list(upstream)]
        return _digest(json.dumps(made_from, sort_keys=True, default=str).encode())

    def is_done(self, stage: str, fingerprint: str) -> bool:
        """Whether the stage was finished from just this, and its files are still there."""
        made_from, names = self._stages.get(stage, ("", []))
        return made_from == fingerprint and all((self.folder / name).is_file() for name in names)

    def files(self, stage: str) -> list[Path]:
        """The files of a finished stage."""
        return [self.folder / name for name in self._stages[stage][1]]

    def strike(self, stage: str) -> None:
        """Declare a stage unfinished, before its files are touched."""
        if self._stages.pop(stage, None) is not None:
            self._save()

    def enter(self, stage: str, fingerprint: str, files: Iterable[Path]) -> None:
        """Declare a stage finished, after its files are in place."""
        names = [f.relative_to(self.folder).as_posix() for f in files]
        self._stages[stage] = fingerprint, names
        self._save()

    def _save(self) -> None:
        stages = {name: {"fingerprint": made, "files": files} for name, (made, files) in self._stages.items()}
        kept = {"stages": stages, "inputs": self._hashes}
        with atomic_write(self.folder / STAGES_FILE) as temporary:
            temporary.write_text(json.dumps(kept, indent=1))

    def _content(self, path: Path) -> str:
        """Hash of a file's content; not read again while its size and time stay the same."""
        status = path.stat()
        name = str(path.resolve())
        known = self._hashes.get(name)
        if known and known[:2] == (status.st_size, status.st_mtime_ns):
            return known[2]
        digest = hashlib.blake2b(digest_size=16)
        with path.open("rb") as file:
            while block := file.read(_HASH_BLOCK):
                digest.update(block)
        self._hashes[name] = (status.st_size, status.st_mtime_ns, digest.hexdigest())
        return digest.hexdigest()


def _digest(data: bytes) -> str:
    return hashlib.blake2b(data, digest_size=16).hexdigest()
