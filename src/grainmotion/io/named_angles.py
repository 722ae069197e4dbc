"""Tables of file names and angles: which angle a radiograph has, whatever their order."""

from __future__ import annotations

import re
from pathlib import Path, PurePath

import numpy as np

from grainmotion._typing import Float
from grainmotion.errors import InputError
from grainmotion.io.angles import in_degrees, unit_in_header
from grainmotion.io.text import read_text

GIVE_NAMES_AND_ANGLES = "give two columns a line, the name of a file and its angle in degrees"
_ANGLE_HEADER = re.compile(r"angle|theta|rotation|phi\b|omega|deg|°", re.IGNORECASE)
_NUMBER = re.compile(r"^[-+]?(\d+([.,]\d*)?|[.,]\d+)([eE][-+]?\d+)?$")


def read_named_angles(path: Path) -> dict[str, float] | None:
    """The angle of each file that a table names, degrees; None if it names no files.

    Columns are separated by tabs, semicolons, commas or blanks; ``#`` begins a comment, a first line without a number
    is a header.  Of several columns of numbers the header has to name that of the angles.
    """
    if path.suffix.lower() == ".npy":
        return None
    lines = [(k, line.split("#")[0].strip()) for k, line in enumerate(read_text(path).split("\n"), start=1)]
    rows = [(k, _cells(line)) for k, line in lines if line]
    header: list[str] = []
    if len(rows) > 1 and not any(_NUMBER.match(cell) for cell in rows[0][1]):
        header, rows = rows[0][1], rows[1:]
    named = [any(map(_is_name, cells)) and any(map(_NUMBER.match, cells)) for _, cells in rows]
    if sum(named) <= len(rows) / 2:
        return None
    width = len(rows[0][1])
    for k, cells in rows:
        if len(cells) != width or sum(_is_name(cell) for cell in cells) != 1:
            raise InputError(str(path), f"line {k} is not one file name and its numbers", GIVE_NAMES_AND_ANGLES)
    column = next(c for c, cell in enumerate(rows[0][1]) if _is_name(cell))
    place = _angle_place(path, header, [c for c in range(width) if c != column], width)
    values = np.array([_number(path, k, cells[place]) for k, cells in rows])
    angles = in_degrees(values, unit_in_header(header[place]) if header else "", str(path))
    table: dict[str, float] = {}
    for (k, cells), angle in zip(rows, angles, strict=True):
        name = PurePath(cells[column].replace("\\", "/")).name
        if name in table:
            raise InputError(str(path), f"line {k} names {name} a second time", "keep one line a file")
        table[name] = float(angle)
    return table


def joined_angles_deg(path: Path, table: dict[str, float], names: tuple[str, ...]) -> Float:
    """The angles of files in their own order, by their names, with or without suffix."""
    stems = {PurePath(name).stem: angle for name, angle in table.items()}
    found = []
    for name in names:
        angle = table.get(name, table.get(PurePath(name).stem, stems.get(PurePath(name).stem)))
        if angle is None:
            held = ", ".join(list(table)[:3])
            fact = f"no line names the radiograph {name}; it names {held}{', ...' if len(table) > 3 else ''}"
            raise InputError(str(path), fact, "add a line with its angle, or leave the file out")
        found.append(angle)
    return np.array(found)


def _cells(line: str) -> list[str]:
    """The cells of a line; names may hold blanks where another mark separates."""
    mark = next((m for m in "\t;," if m in line), None)
    parts = line.split(mark) if mark else line.split()
    return [cell.strip().strip("\"'").strip() for cell in parts]


def _is_name(cell: str) -> bool:
    """Whether a cell is a file's name: it holds a letter, and is no number."""
    no_number = not _NUMBER.match(cell) and cell.lower().lstrip("+-") not in ("nan", "inf", "infinity")
    return no_number and any(letter.isalpha() for letter in cell)


def _angle_place(path: Path, header: list[str], columns: list[int], width: int) -> int:
    """The column of the angles."""
    if len(columns) == 1:
        return columns[0]
    told = [c for c in columns if len(header) == width and _ANGLE_HEADER.search(header[c])]
    if len(told) == 1:
        return told[0]
    fact = f"it has {len(columns)} columns beside the file names, and which of them holds the angles is not clear"
    raise InputError(str(path), fact, "leave only the angles, or name that column angle_deg in a header")


def _number(path: Path, line: int, cell: str) -> float:
    if not _NUMBER.match(cell):
        raise InputError(str(path), f"line {line} has the angle '{cell}'", GIVE_NAMES_AND_ANGLES)
    return float(cell.replace(",", "."))
