"""Angles of a phoenix scan: places of the stage in the ``.pcj`` file, or constant steps."""

from __future__ import annotations

import numpy as np

from grainmotion._typing import Float
from grainmotion.errors import InputError
from grainmotion.io.scanners.key_file import COPY_FROM_SCANNER, KeyFile, as_number, read_any_text


def stage_angles(keys: KeyFile, numbers: list[int], count: int) -> Float:
    """Angles of the images with ``numbers``: places of the stage in the ``.pcj`` file, else constant steps."""
    table = keys.path.with_suffix(".pcj")
    if not table.is_file():
        return (np.array(numbers) - 1.0) * keys.needed("CT", "RotationSector") / count
    rows = [line.strip(";").split() for line in read_any_text(table).split("\n")]
    head = next((row for row in rows if "ImgNr" in row and "RS" in row), None)
    if head is None:
        raise InputError(str(table), "its section [Data] has no columns ImgNr and RS", COPY_FROM_SCANNER)
    at, stage = head.index("ImgNr"), head.index("RS")
    cells = [(as_number(row[at]), as_number(row[stage])) for row in rows if len(row) > max(at, stage)]
    angles = {int(n): angle for n, angle in cells if n is not None and angle is not None}
    missing = [n for n in numbers if n not in angles]
    if missing:
        fact = f"it holds {len(angles)} places of the stage, and none of image {missing[0]}"
        raise InputError(str(table), fact, "copy it again, or move it away: constant steps are taken then")
    return np.array([angles[n] for n in numbers])
