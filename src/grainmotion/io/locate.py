"""Files behind a path, a pattern or a folder of the experiment file, in the order of the numbers in their names."""

from __future__ import annotations

import difflib
import glob
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from fnmatch import fnmatchcase
from pathlib import Path

from grainmotion.diagnosis.file_names import natural_order
from grainmotion.errors import InputError
from grainmotion.io.files import checked_file
from grainmotion.io.formats import family, unreadable

INSPECTION_PICTURE = "inspection.png"
"""What `grainmotion inspect` draws beside the radiographs, which is none of them."""


@dataclass(frozen=True)
class Located:
    """Files that belong together.

    Attributes
    ----------
    files : tuple of Path
        In the order of the numbers in their names; a single one for the path of a file.
    series : bool
        Whether they were found by a pattern or a folder, so that their names tell something.
    note : str
        What was done to find them, if it is not obvious; else empty.
    """

    files: tuple[Path, ...]
    series: bool
    note: str = ""


def locate(name: str, folder: Path) -> Located:
    """The files that ``name`` means, from ``folder``: a file, all images in a folder, or those of a pattern."""
    path = folder / name
    if name.startswith("~") and not path.exists():
        name = str(Path(name).expanduser())
        path = Path(name)
    if path.is_dir():
        return _of_folder(path)
    if path.exists() or not glob.has_magic(name):
        if not path.exists():
            raise _not_found(path)
        return Located((checked_file(path),), series=False)
    note = ""
    hits = _matches(name, folder, fnmatchcase)
    if not hits:
        hits = _matches(name, folder, lambda text, pattern: fnmatchcase(text.lower(), pattern.lower()))
        if hits:
            note = f"no file matches {name} in these letters; {len(hits)} files that differ in case are taken"
    if not hits:
        raise _no_match(path)
    order = natural_order([str(hit) for hit in hits])
    return Located(tuple(checked_file(hits[k]) for k in order), series=True, note=note)


def _matches(name: str, folder: Path, match: Callable[[str, str], bool]) -> list[Path]:
    """Paths that match a pattern part by part; a part that exists as it is written is no pattern.

    So folders called ``ref [1]`` are found.  Names that begin with a dot are left out, as glob does.
    """
    pattern = Path(name)
    bases = [Path(pattern.anchor)] if pattern.is_absolute() else [folder]
    for part in pattern.parts[1:] if pattern.is_absolute() else pattern.parts:
        found: list[Path] = []
        for base in bases:
            literal = base / part
            if literal.exists() or part == "..":
                found.append(literal)
            elif base.is_dir():
                names = (item.name for item in _content(base))
                found += [base / n for n in names if match(n, part) and (part[0] == "." or n[0] != ".")]
        bases = found
    return sorted(bases)


def _content(folder: Path) -> list[Path]:
    try:
        return list(folder.iterdir())
    except OSError as error:
        raise InputError(
            str(folder), f"the folder cannot be read: {error.strerror}", "change its permissions"
        ) from error


def _of_folder(path: Path) -> Located:
    """All images of a folder, which must be of one format."""
    files = [item for item in _content(path) if item.is_file() and not item.name.startswith(".")]
    images = [item for item in files if family(item) is not None and item.name != INSPECTION_PICTURE]
    suffixes = Counter(item.suffix.lower() for item in files)
    content = ", ".join(f"{count} {suffix or 'without suffix'}" for suffix, count in sorted(suffixes.items()))
    if not images:
        if files:
            error = unreadable(min(files, key=lambda item: -suffixes[item.suffix.lower()]))
            raise InputError(str(path), f"the folder holds no image that can be read: {content}", error.remedy)
        raise InputError(str(path), "the folder is empty", "name the folder or files of the images")
    if len({family(item) for item in images}) > 1:
        fact = f"the folder holds images of several formats: {content}"
        raise InputError(str(path), fact, f'say which: "{path.name}/*{images[0].suffix}"')
    order = natural_order([item.name for item in images])
    return Located(tuple(checked_file(images[k]) for k in order), series=True)


def _not_found(path: Path) -> InputError:
    """The error about a file that is not there, with the names that are most like it."""
    remedy = "check the path; paths start at the experiment file's folder"
    if any(ord(character) < ord(" ") for character in str(path)):
        fact = f"no such file: {str(path)!r} holds a control character, as \\b and \\t between double quotes are"
        return InputError(str(path.parent), fact, "write / instead of \\ between folders, on Windows too")
    if "\\" in path.name:
        return InputError(str(path), "no such file", "write / instead of \\ between folders")
    if path.parent.is_dir():
        names = [item.name for item in path.parent.iterdir()]
        near = difflib.get_close_matches(path.name, names, n=2, cutoff=0.7)
        if near:
            remedy = f"did you mean '{near[0]}'?"
    return InputError(str(path), "no such file", remedy)


def _no_match(path: Path) -> InputError:
    """The error about a pattern without files, with what its folder holds."""
    parent = path.parent
    while glob.has_magic(str(parent)) and not parent.exists():
        parent = parent.parent
    remedy = "check the pattern and its folder; paths start at the experiment file's folder"
    if "\\" in path.name:
        return InputError(str(path), "no file matches", "write / instead of \\ between folders")
    if not parent.is_dir():
        return InputError(str(path), f"no file matches: there is no folder {parent}", remedy)
    suffixes = Counter(item.suffix for item in parent.iterdir() if item.is_file())
    content = ", ".join(f"{count} *{suffix}" for suffix, count in suffixes.most_common(4)) or "no file"
    return InputError(str(path), f"no file matches, and the folder holds {content}", remedy)
