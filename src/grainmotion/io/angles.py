"""Angles of the views from text files, as spreadsheets and scanners leave them, and from datasets of HDF5 files."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType

import numpy as np

from grainmotion._typing import Float
from grainmotion.errors import InputError
from grainmotion.io.files import checked_file
from grainmotion.io.formats import check_npy
from grainmotion.io.text import read_text

_DEGREES_PER_UNIT: Mapping[str, float] = MappingProxyType({
    name: degrees
    for names, degrees in (
        ("deg degs degree degrees °", 1.0),
        ("rad rads radian radians", 180 / np.pi),
        ("mrad millirad milliradian milliradians", 0.18 / np.pi),
        ("mdeg millideg millidegree millidegrees", 1e-3),
        ("turn turns rev revs revolution revolutions", 360.0),
        ("gon gons grad grads gradian gradians", 0.9),
        ("arcmin arcminute arcminutes", 1 / 60),
        ("arcsec arcsecond arcseconds", 1 / 3600),
    )
    for name in names.split()
})  # fmt: skip
"""Degrees in one unit of angle, by the names in use."""

GIVE_ONE_A_LINE = "give one angle a line, degrees; # begins a comment"
_NOT_NUMBERS = ("nan", "inf", "infinity")


def in_degrees(values: Float, unit: str, where: str) -> Float:
    """Angles in degrees from those in a named unit; an empty name means degrees, an unknown one is refused."""
    name = unit.strip().lower().rstrip(".")
    if name and name not in _DEGREES_PER_UNIT:
        remedy = f"known units are {', '.join(_DEGREES_PER_UNIT)}; give the angles as a list or text file, in degrees"
        raise InputError(where, f"its angles have the unknown unit '{unit}'", remedy)
    return values * _DEGREES_PER_UNIT.get(name, 1.0)


def read_angles(path: str | Path) -> Float:
    """The angles of a text file, degrees: a column, one line, or two columns of which the first counts the views.

    Columns are separated by tab, semicolon, comma or blanks; a decimal comma is understood.  ``#`` begins a comment; a
    first line of words is a header.
    """
    path = Path(path)
    if path.suffix.lower() == ".npy":
        return _of_array(path)
    lines = [(k, line.split("#")[0].strip()) for k, line in enumerate(read_text(path).split("\n"), start=1)]
    lines = [(k, line) for k, line in lines if line]
    if not lines:
        raise InputError(str(path), "it holds no angle", GIVE_ONE_A_LINE)
    split = _separator([line for _, line in lines], path)
    header = [cell.strip(" \"'") for cell in split(lines[0][1])]
    if len(lines) > 1 and not any(map(_is_number, header)):
        lines = lines[1:]
    else:
        header = []
    rows = [[_number(cell, path, k, line) for cell in split(line)] for k, line in lines]
    widths = {len(row) for row in rows}
    if len(rows) == 1 or widths == {1}:
        angles = np.array([value for row in rows for value in row])
        return in_degrees(angles, unit_in_header(" ".join(header)), str(path))
    if len(widths) > 1:
        k = next(k for (k, _), row in zip(lines, rows) if len(row) != len(rows[0]))
        fact = f"line {k} has another number of columns than line {lines[0][0]}, {len(rows[0])}"
        raise InputError(str(path), fact, GIVE_ONE_A_LINE)
    return _angle_column(np.array(rows), header, path)


def _of_array(path: Path) -> Float:
    """The angles in a .npy file."""
    check_npy(checked_file(path))
    try:
        angles = np.load(path, allow_pickle=False)
    except (ValueError, EOFError, OSError) as error:
        fact = f"truncated or damaged .npy ({error})"
        raise InputError(str(path), fact, "save it again with numpy.save") from error
    if angles.dtype.kind not in "iuf" or max(angles.shape, default=0) != angles.size:
        raise InputError(str(path), f"an array {angles.shape} of {angles.dtype}", "give one angle a view, degrees")
    return np.asarray(angles.ravel(), dtype=float)


def _separator(lines: list[str], path: Path) -> Callable[[str], list[str]]:
    """How lines are divided into cells: by tabs or semicolons, by commas unless these are decimal, or by blanks."""
    for mark in "\t;":
        if any(mark in line for line in lines):
            return lambda line: [cell for cell in line.strip(mark).split(mark) if cell.strip()]
    decimal = re.compile(r"^[-+]?\d+,\d+$")
    numbers = [line for line in lines if re.search(r"\d", line) and not re.search(r"[^\W\d_]{2}", line)]
    comma = [line for line in numbers if "," in line]
    single = bool(comma) and all(decimal.match(line) for line in comma)
    if single and _has_decimal_commas(numbers, path):
        return lambda line: [line]
    cells = [line.split() for line in numbers]
    if comma and all(re.match(r"^[-+]?\d+(,\d+)?$", cell) for row in cells for cell in row) and len(cells[0]) > 1:
        return str.split  # several numbers with decimal commas, separated by blanks
    if comma:
        return lambda line: [cell for cell in line.strip(", ").split(",") if cell.strip()]
    return str.split


def _has_decimal_commas(lines: list[str], path: Path) -> bool:
    """Whether lines such as 12,5 are one number each, rather than the number of a view and a whole angle."""
    before, after = zip(*((line + ",").split(",")[:2] for line in lines))
    if not _counts(before):
        return True
    leading_zeros = any(len(cell) > 1 and cell.startswith("0") for cell in after)
    same_digits = len({len(cell) for cell in after}) == 1
    if leading_zeros and same_digits:
        return True
    angles = [int(cell or 0) for cell in after]
    if not leading_zeros and not same_digits and (angles == sorted(angles) or angles == sorted(angles, reverse=True)):
        return False
    fact = f"'{lines[-1]}' may be one number with a decimal comma, or the number of a view and an angle"
    raise InputError(str(path), fact, "write decimals with a point, or leave only the angles")


def _counts(cells: Sequence[str]) -> bool:
    """Whether whole numbers count 0, 1, 2, ... or 1, 2, 3, ..."""
    if not all(cell.strip().isdigit() for cell in cells):
        return False
    values = [int(cell) for cell in cells]
    return len(values) > 1 and values[0] in (0, 1) and values == list(range(values[0], values[0] + len(values)))


def unit_in_header(name: str) -> str:
    """The unit in the name of a column: radians if it says so, else degrees."""
    unit = re.search(r"(?<![a-z])(m?rad(ian)?s?)(?![a-z])", name.lower())
    return unit.group(1) if unit else ""


def _is_number(cell: str) -> bool:
    try:
        float(cell.replace(",", "."))
    except ValueError:
        return False
    return True


def _number(cell: str, path: Path, k: int, line: str) -> float:
    text = cell.strip().strip("\"'").removesuffix("°").strip()
    if text.lower().lstrip("+-") in _NOT_NUMBERS:
        raise InputError(str(path), f"line {k} is '{line}', and an angle is a finite number", GIVE_ONE_A_LINE)
    try:
        return float(text.replace(",", ".") if text.count(",") == 1 and "." not in text else text)
    except ValueError as error:
        shown = line if len(line) < 60 else f"{line[:57]}..."
        raise InputError(str(path), f"line {k} is '{shown}'", GIVE_ONE_A_LINE) from error


def _angle_column(table: Float, header: list[str], path: Path) -> Float:
    """The column of angles: the one that its header names so, or the second of two if the first counts the views."""
    named = [k for k, name in enumerate(header) if re.search(r"angle|theta|rotation|phi\b|omega|deg|°", name.lower())]
    views = np.arange(len(table))
    counts = [k for k in range(table.shape[1]) if np.array_equal(table[:, k] - table[0, k], views)
              and table[0, k] in (0, 1)]  # fmt: skip
    if len(header) == table.shape[1] and len(named) == 1:
        return in_degrees(table[:, named[0]], unit_in_header(header[named[0]]), str(path))
    if table.shape[1] == 2 and counts == [0] and len(table) > 2:
        return table[:, 1]
    fact = f"it has {table.shape[1]} columns, and which of them holds the angles is not clear"
    raise InputError(str(path), fact, "leave only the angles, or name that column angle_deg in a header")
