"""Angles of a Nikon scan: constant steps, or a table beside the ``.xtekct`` file, ``.ang`` or ``_ctdata.txt``."""

from __future__ import annotations

import re
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


def nikon_angles(keys: KeyFile, numbers: list[int]) -> tuple[Float | None, tuple[Finding, ...]]:
    """Angles of the images with ``numbers``: of the table beside the file, else constant steps."""
    start, step = keys.number(MAIN, "InitialAngle") or 0.0, keys.number(MAIN, "AngularStep")
    steps = None if step is None else start + step * (np.array(numbers) - 1.0)
    path = _table_path(keys)
    if path is None:
        return steps, ()
    table = _read_table(path)
    missing = [n for n in numbers if n not in table]
    if missing:
        fact = f"it holds {len(table)} angles, and none of image {missing[0]}"
        raise InputError(str(path), fact, "copy it again, or remove it: constant steps of AngularStep are taken then")
    angles = np.array([table[n] for n in numbers])
    first = table[min(table)]
    angles = angles if abs(first - start) < abs(first) else start + angles  # most tables count from the start
    if steps is not None and step:
        if np.abs(angles - steps).max() <= MAX_READOUT_ERROR * abs(step) and not _uses_table(keys):
            return steps, ()
        if len(numbers) > 2 and np.abs((angles - start) + (steps - start)).max() < abs(step):
            fact = f"its angles run against AngularStep = {step:g}, by which the scanner reconstructs; that was taken"
            return steps, (Finding(Level.WARNING, "angle-table", str(path), fact, remedy="see geometry.angles_deg"),)
    note = Finding(Level.NOTE, "angle-table", str(path), "its angles were taken, not constant steps")
    return angles, (note,)


def _uses_table(keys: KeyFile) -> bool:
    return keys.text("CTPro", "AngleFile_Use").lower() == "true"


def _table_path(keys: KeyFile) -> Path | None:
    """The file with the angles of a scan."""
    folder, name = keys.path.parent, keys.text(MAIN, "Name")
    names = (
        f"{name}.ang",
        f"{keys.path.stem}.ang",
        "_ctdata.txt",
        f"{name}_ctdata.txt",
        f"{keys.path.stem}_ctdata.txt",
    )
    return next((folder / name for name in names if (folder / name).is_file()), None)


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
