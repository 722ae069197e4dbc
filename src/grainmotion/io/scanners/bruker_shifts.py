"""Shifts of each image of a SkyScan, in a CSV beside its log."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from grainmotion._typing import Float
from grainmotion.errors import InputError
from grainmotion.io.scanners.key_file import COPY_FROM_SCANNER, KeyFile, as_number, read_any_text
from grainmotion.model.finding import Finding, Level


def image_shifts(keys: KeyFile, numbers: list[int]) -> tuple[Float | None, tuple[Finding, ...]]:
    """Columns and rows by which features of each image lie further, ``(images, 2)``, if a CSV tells.

    As TIGRE reads it: x and y of each image, pixels of the camera without binning, by which the camera is moved to
    higher columns and downwards.
    """
    acquisition = "Acquisition"
    prefix = keys.text(acquisition, "Filename Prefix").lower()
    tables = sorted(
        path for path in keys.path.parent.iterdir()
        if path.suffix.lower() == ".csv" and path.stem.lower() in (prefix, f"{prefix}_ts", f"{prefix}ts")
    )  # fmt: skip
    if not tables or not numbers:
        return None, ()
    path = tables[0]
    if keys.text(acquisition, "TS modified at"):
        fact = "its shifts are not used: the log tells that the images were shifted by them already"
        return None, (Finding(Level.NOTE, "views", str(path), fact),)
    shifts = _read_shifts(path)
    missing = [n for n in numbers if n not in shifts]
    if missing:
        fact = f"it holds shifts of {len(shifts)} images, and none of image {missing[0]}"
        raise InputError(str(path), fact, "copy it again, or move it away: the images are not shifted then")
    binning = re.findall(r"\d+", keys.text(acquisition, "Camera binning")) or ["1"]
    by = np.array([float(binning[0]), float(binning[-1])])
    fact = f"its shifts, up to {max(map(max, map(_sizes, shifts.values()))):g} pixels of the camera, were used"
    remedy = "their signs are not documented: if the volume is sharper without it, move the file away"
    note = Finding(Level.WARNING, "views", str(path), fact, remedy=remedy)
    return -np.array([shifts[n] for n in numbers]) / by, (note,)


def _sizes(shift: tuple[float, float]) -> tuple[float, float]:
    return abs(shift[0]), abs(shift[1])


def _read_shifts(path: Path) -> dict[int, tuple[float, float]]:
    """Shifts by the number of their image: rows of number, x and y below a head of other lines."""
    shifts: dict[int, tuple[float, float]] = {}
    for k, line in enumerate(read_any_text(path).split("\n"), start=1):
        mark = ";" if ";" in line else ","
        row = [as_number(cell) for cell in line.split(mark)[:3]]
        if len(row) == 3 and row[0] is not None and row[1] is not None and row[2] is not None:
            shifts[int(row[0])] = row[1], row[2]
        elif shifts and line.strip():
            fact = f"line {k} is '{line.strip()[:40]}', no number of an image with its shifts"
            raise InputError(str(path), fact, COPY_FROM_SCANNER)
    if not shifts:
        raise InputError(str(path), "it holds no shift of an image", COPY_FROM_SCANNER)
    return shifts
