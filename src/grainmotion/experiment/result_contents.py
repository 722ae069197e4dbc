"""What files of a results folder are, by the catalogue of all that a run writes."""

from __future__ import annotations

import re
from collections import Counter
from fnmatch import fnmatchcase
from pathlib import Path

from grainmotion.experiment.folder_contents import RESULT_MARK
from grainmotion.io.catalogue import FILES, FileKind, kind_of

MAX_RESULT_DEPTH = 3
"""Folders between a results folder and a file in it."""


def describe_result(path: Path) -> tuple[tuple[str, str], ...]:
    """Content and units of a file in a results folder, one line each; nothing for other files."""
    folder = results_folder_of(path)
    kind = None if folder is None else _kind(path.absolute().relative_to(folder).as_posix())
    if kind is None:
        return ()
    units: dict[str, list[str]] = {}
    for name, (unit, _) in {**kind.columns, **kind.items}.items():
        units.setdefault(_unit_words(unit), []).append(name)
    note = (("Note", _plain(kind.note)),) if kind.note else ()
    lines = tuple((unit, ", ".join(names)) for unit, names in units.items())
    where = (("Meaning", "of each column: docs/files.md; frame and signs: docs/conventions.md"),) if lines else ()
    return (("Result of a run", kind.content), *note, *lines, *where)


def describe_results(folder: Path) -> tuple[tuple[str, str], ...]:
    """The files of a results folder or of one in it, one line each; those of the states once for all states."""
    top = results_folder_of(folder / RESULT_MARK) or folder
    place = folder.absolute().relative_to(top.absolute())
    states: Counter[str] = Counter()
    lines: list[tuple[str, str]] = []
    for item in sorted(folder.iterdir()):
        kind = _kind((place / item.name).as_posix())
        if kind is not None:
            lines.append((item.name, kind.content))
        elif item.is_dir() and place == Path():
            states.update(entry.name for entry in item.iterdir() if _kind(f"{item.name}/{entry.name}") is not None)
    for name, count in sorted(states.items()):
        kind = _kind(f"STATE/{name}")
        if kind is not None:
            lines.append((f"STATE/{name}", f"{kind.content} ({count} {'state' if count == 1 else 'states'})"))
    return tuple(lines)


def results_folder_of(path: Path) -> Path | None:
    """The results folder that a path lies in, if it lies in one."""
    return next((p for p in path.absolute().parents[:MAX_RESULT_DEPTH] if (p / RESULT_MARK).is_file()), None)


def _kind(path: str) -> FileKind | None:
    """The kind of a file, also within the folder for DEM codes."""
    return next((kind for kind in FILES if fnmatchcase(path, kind.path)), None) or kind_of(path)


def _unit_words(unit: str) -> str:
    return {"": "Text", "text": "Text", "yes or no": "Yes or no", "1": "No unit"}.get(unit, f"In {unit}")


def _plain(note: str) -> str:
    """A note of the page without its marks of Markdown."""
    return re.sub(r"\[[^\]]*\]\(([^)#]*)[^)]*\)", r"docs/\1", note).replace("**", "")
