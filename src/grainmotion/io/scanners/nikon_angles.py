"""Angles of a Nikon scan: constant steps, or a table beside the ``.xtekct`` file, ``.ang`` or ``_ctdata.txt``."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from grainmotion._typing import Float
from grainmotion.errors import InputError
from grainmotion.io.scanners.key_file import COPY_FROM_SCANNER, KeyFile, as_number, read_any_text
from grainmotion.model.finding import Finding, Level

MAIN = "XTekCT"
"""The section of an ``.xtekct`` file that holds the geometry."""
MAX_READOUT_ERROR = 0.05
"""Difference, in steps, of a table of angles from constant steps up to which it is a reading of these steps.

The encoder's readings in public scans differ by 0.01 steps; the scanner's own reconstruction takes the constant steps.
"""


@dataclass(frozen=True)
class AngleTable:
    """Angles by the number of their image, degrees, and the file that holds them; None and no angle without one."""

    path: Path | None
    angles: Mapping[int, float]


def angle_table(keys: KeyFile) -> AngleTable:
    """The table beside an ``.xtekct`` file."""
    folder, name, stem = keys.path.parent, keys.text(MAIN, "Name"), keys.path.stem
    names = (f"{name}.ang", f"{stem}.ang", "_ctdata.txt", f"{name}_ctdata.txt", f"{stem}_ctdata.txt")
    path = next((folder / name for name in names if (folder / name).is_file()), None)
    return AngleTable(path, {} if path is None else _read_table(path))


def nikon_angles(keys: KeyFile, numbers: list[int], table: AngleTable) -> tuple[Float | None, tuple[Finding, ...]]:
    """Angles of the images with ``numbers``: of the table, else constant steps."""
    start, step = keys.number(MAIN, "InitialAngle") or 0.0, keys.number(MAIN, "AngularStep")
    steps = None if step is None else start + step * (np.array(numbers) - 1.0)
    if table.path is None:
        return steps, ()
    missing = [n for n in numbers if n not in table.angles]
    if missing:
        fact = f"it holds {len(table.angles)} angles, and none of image {missing[0]}"
        remedy = "copy it again, or move it away: constant steps of AngularStep are taken then"
        raise InputError(str(table.path), fact, remedy)
    angles, first = np.array([table.angles[n] for n in numbers]), table.angles[min(table.angles)]
    angles = angles if abs(first - start) < abs(first) else start + angles  # most tables count from the start
    if steps is not None and step:
        if np.abs(angles - steps).max() <= MAX_READOUT_ERROR * abs(step) and not _uses_table(keys):
            return steps, ()
        if len(numbers) > 2 and np.abs((angles - start) + (steps - start)).max() < abs(step):
            fact = f"its angles run against AngularStep = {step:g}, by which the scanner reconstructs; that was taken"
            remedy = "if the table is right, give it as geometry.angles_deg"
            return steps, (Finding(Level.WARNING, "angle-table", str(table.path), fact, remedy=remedy),)
    fact = "its angles were taken, not constant steps"
    return angles, (Finding(Level.NOTE, "angle-table", str(table.path), fact),)


def _uses_table(keys: KeyFile) -> bool:
    return keys.text("CTPro", "AngleFile_Use").lower() == "true"


def _read_table(path: Path) -> dict[int, float]:
    """Angles by the number of their image: rows of number, angle and perhaps time, below a line that names them."""
    lines = read_any_text(path).split("\n")
    heads = [k for k, line in enumerate(lines) if "angle" in line.lower()]
    table: dict[int, float] = {}
    for k, line in enumerate(lines[heads[-1] + 1 :] if heads else lines, start=heads[-1] + 2 if heads else 1):
        if not line.strip():
            continue
        cells = re.split(r"[\s:;]+", line.strip())
        number, angle = (as_number(cell) for cell in [*cells, ""][:2])
        if number is None or angle is None or number % 1 or int(number) in table:
            raise InputError(
                str(path), f"line {k} is '{line.strip()[:40]}', no number of an image and angle", COPY_FROM_SCANNER
            )
        table[int(number)] = angle
    if not table:
        raise InputError(str(path), "it holds no angle", COPY_FROM_SCANNER)
    return table
