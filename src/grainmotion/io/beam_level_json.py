"""``beam_level.json``: level of the beam in each view of the reference scan, ``{"levels": [...], "source": "air"}``."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from grainmotion.calibration.beam_level import BeamLevels
from grainmotion.errors import InputError
from grainmotion.io.contents import about
from grainmotion.io.files import atomic_write, checked_file

BEAM_LEVEL_UNIT = "line integral, dimensionless; subtracted from each view"


def write_beam_levels(path: str | Path, levels: BeamLevels) -> None:
    """Write the levels; they are read back to the bit."""
    data = {**about(), "unit": BEAM_LEVEL_UNIT, "levels": levels.levels.tolist(), "source": levels.source}
    with atomic_write(path) as temporary:
        temporary.write_text(json.dumps(data, indent=1))


def read_beam_levels(path: str | Path) -> BeamLevels:
    """Read levels; an `InputError` names a file that holds none."""
    path = checked_file(path)
    try:
        data = json.loads(path.read_text())
        source = data["source"]
        if source not in ("none", "air", "reconstruction"):
            raise ValueError(f"source '{source}'")
        return BeamLevels(np.array(data["levels"], dtype=float), source)
    except (ValueError, KeyError, TypeError) as error:
        raise InputError(str(path), f"it holds no levels of the beam ({error})", "delete it") from error
