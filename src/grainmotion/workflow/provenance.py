"""Provenance: which stages of a run are done, and from which inputs.

A stage's fingerprint is a hash of its settings, of the content of its input files and of the fingerprints of the
stages before it.  ``stages.json`` keeps the fingerprints of finished stages.  A stage is removed from it before its
files are written and added afterwards, so that no unfinished stage looks finished after a run was killed.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Generic, TypeVar

from grainmotion import __version__
from grainmotion.io.files import atomic_write
from grainmotion.model.progress import counted

STAGES_FILE = "stages.json"
_HASH_BLOCK = 1 << 22  # bytes of a file hashed at a time
T = TypeVar("T")


@dataclass(frozen=True, eq=False)
class Stage(Generic[T]):
    """One step of a run with a result of type T: ``run`` computes it, ``write`` saves it, ``load`` reads it back."""

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
        self._used: dict[str, str] = {}  # hashes of files as stages used them
        self.made_by = ""  # version of the package that finished the last stage
        self._made_from: dict[str, tuple[tuple[Path, ...], tuple[str, ...]]] = {}
        self.read()

    def read(self) -> None:
        """Read which stages are done."""
        try:
            kept = json.loads((self.folder / STAGES_FILE).read_text())
            self.made_by = str(kept.get("grainmotion", ""))
            self._stages = {n: (str(s["fingerprint"]), list(s["files"])) for n, s in kept["stages"].items()}
            self._hashes = {name: (int(s), int(t), str(h)) for name, (s, t, h) in kept["inputs"].items()}
        except (OSError, ValueError, KeyError, TypeError, AttributeError):
            self._stages, self._hashes = {}, {}  # no file, or an unreadable one: every stage is repeated
        self._used = {name: digest for name, (_, _, digest) in self._hashes.items()}

    def fingerprint(self, settings: object, files: Iterable[Path] = (), upstream: Iterable[str] = ()) -> str:
        """Hash of a stage's inputs; ``settings`` must be plain data, as JSON holds it."""
        paths, before = [Path(f) for f in files], list(upstream)
        contents = [self._content(path) for path in counted(paths)]
        made_from = [__version__, settings, contents, before]
        data = json.dumps(made_from, sort_keys=True, default=str).encode()
        digest = hashlib.blake2b(data, digest_size=16).hexdigest()
        known = [self._used.get(_name(path), "") for path in paths]
        there = any(known)  # else the folder was moved, and all its files have other names
        changed = [path for path, was, now in zip(paths, known, contents, strict=True) if there and was != now]
        self._made_from.setdefault(digest, (tuple(changed), tuple(before)))
        return digest

    def made_from(self, fingerprint: str) -> tuple[tuple[Path, ...], tuple[str, ...]]:
        """Of a fingerprint that was asked for: files that are new or changed since then, and those before it."""
        return self._made_from.get(fingerprint, ((), ()))

    def has(self, stage: str) -> bool:
        """Whether the stage was finished, from whatever."""
        return stage in self._stages

    def is_recorded(self, stage: str, fingerprint: str) -> bool:
        """Whether the stage was finished with this fingerprint, wherever its files are now."""
        return self._stages.get(stage, ("", []))[0] == fingerprint

    def is_done(self, stage: str, fingerprint: str) -> bool:
        """Whether the stage was finished with this fingerprint and its files still exist."""
        made_from, names = self._stages.get(stage, ("", []))
        return made_from == fingerprint and all((self.folder / name).is_file() for name in names)

    def files(self, stage: str) -> list[Path]:
        """The files of a finished stage."""
        return [self.folder / name for name in self._stages[stage][1]]

    def all_files(self) -> list[Path]:
        """The files of all finished stages."""
        return [self.folder / name for _, names in self._stages.values() for name in names]

    def discard(self, stage: str) -> None:
        """Mark a stage as unfinished, before its files are touched."""
        if self._stages.pop(stage, None) is not None:
            self._save()

    def add(self, stage: str, fingerprint: str, files: Iterable[Path]) -> None:
        """Mark a stage as finished, after its files are in place."""
        names = [f.relative_to(self.folder).as_posix() for f in files]
        self._stages[stage] = fingerprint, names
        self._save()

    def _save(self) -> None:
        stages = {name: {"fingerprint": made, "files": files} for name, (made, files) in self._stages.items()}
        kept = {"grainmotion": __version__, "stages": stages, "inputs": self._hashes}
        with atomic_write(self.folder / STAGES_FILE) as temporary:
            temporary.write_text(json.dumps(kept, indent=1))

    def _content(self, path: Path) -> str:
        """Hash of a file's content; not read again while its size and time stay the same, nor once it is gone."""
        name = _name(path)
        known = self._hashes.get(name)
        try:
            status = path.stat()
        except FileNotFoundError:
            if known is None:
                raise
            return known[2]  # it was moved away after it was used, as to an archive while a watch goes on
        if known and known[:2] == (status.st_size, status.st_mtime_ns):
            return known[2]
        digest = hashlib.blake2b(digest_size=16)
        with path.open("rb") as file:
            while block := file.read(_HASH_BLOCK):
                digest.update(block)
        self._hashes[name] = (status.st_size, status.st_mtime_ns, digest.hexdigest())
        return digest.hexdigest()


def _name(path: Path) -> str:
    """The absolute name of a file, without links; of its folder these are followed once a process."""
    there = _folder(path.parent.absolute()) / path.name
    return str(there.resolve() if there.is_symlink() else there)


@cache
def _folder(folder: Path) -> Path:
    return folder.resolve()
