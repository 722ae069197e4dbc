"""``calibration.json``: corrections of the scanner estimated from the reference scan, with standard deviations.

``{"grainmotion", "frame", "geometry": {"corrections": [{"name", "value", "sd", "unit"}], "residual_before",
"residual_after"}, "hardening": {"coefficients", "longest", "sd"}}``; either is null if it was not estimated, and ``sd``
is null for a correction that the data do not determine.  ``unit`` is "mm" for shifts and "degrees" for angles.
"""

from __future__ import annotations

import json
import math
from pathlib import Path

from grainmotion.calibration.corrections import Calibration, Correction, from_table_unit
from grainmotion.errors import InputError
from grainmotion.io.contents import about
from grainmotion.io.files import atomic_write, checked_file
from grainmotion.model.geometry import Geometry
from grainmotion.preprocessing.beam_hardening import Hardening


def write_calibration(path: str | Path, calibration: Calibration | None, hardening: Hardening | None) -> None:
    """Write a ``calibration.json``: corrections of the geometry, and the curve that undoes beam hardening."""
    geometry = curve = None
    if calibration is not None:
        rows = [
            {"name": c.name, "value": c.in_unit[0], "sd": c.in_unit[1] if c.determined else None, "unit": c.unit}
            for c in calibration.corrections
        ]
        before, after = calibration.residuals
        geometry = {"corrections": rows, "residual_before": before, "residual_after": after}
    if hardening is not None:
        curve = {"coefficients": hardening.coefficients, "longest": hardening.longest, "sd": hardening.sd}
    with atomic_write(path) as temporary:
        temporary.write_text(json.dumps({**about(), "geometry": geometry, "hardening": curve}, indent=1))


def read_calibration(path: str | Path, geometry: Geometry) -> tuple[Calibration | None, Hardening | None]:
    """Read a ``calibration.json``; the corrections are applied to ``geometry``, the nominal one of the scan."""
    path = checked_file(path)
    calibration = hardening = None
    try:
        data = json.loads(path.read_text())
        estimated, curve = data["geometry"], data["hardening"]
        if estimated is not None:
            rows = tuple(
                Correction(
                    row["name"],
                    from_table_unit(row["name"], float(row["value"])),
                    math.inf if row["sd"] is None else from_table_unit(row["name"], float(row["sd"])),
                )
                for row in estimated["corrections"]
            )
            residuals = (float(estimated["residual_before"]), float(estimated["residual_after"]))
            calibration = Calibration.of(geometry, rows, residuals)
        if curve is not None:
            coefficients = tuple(float(c) for c in curve["coefficients"])
            hardening = Hardening(coefficients, float(curve["longest"]), float(curve["sd"]))
    except (ValueError, KeyError, TypeError) as error:
        raise InputError(str(path), f"it holds no calibration: {error}", "write it with write_calibration") from error
    return calibration, hardening
