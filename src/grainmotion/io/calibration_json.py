"""``calibration.json``: what the reference scan told of the machine, with units and standard deviations.

``{"geometry": {"corrections": [{"name", "value", "sd", "unit"}], "residual_before", "residual_after"},
"hardening": {"coefficients", "longest", "sd"}}``; either is null if it was not asked for, and ``sd`` is null for
a correction that the data do not determine.
"""

from __future__ import annotations

import json
import math
from pathlib import Path

from grainmotion.calibration.corrections import Calibration, Correction, corrected
from grainmotion.errors import InputError
from grainmotion.io.files import atomic_write, checked_file
from grainmotion.model.geometry import Geometry
from grainmotion.preprocessing.beam_hardening import Hardening


def write_calibration(path: str | Path, calibration: Calibration | None, hardening: Hardening | None) -> None:
    """Write what was found; None for what was not asked for."""
    geometry = curve = None
    if calibration is not None:
        rows = [
            {"name": c.name, "value": c.value, "sd": c.sd if c.determined else None, "unit": c.unit}
            for c in calibration.corrections
        ]
        before, after = calibration.residuals
        geometry = {"corrections": rows, "residual_before": before, "residual_after": after}
    if hardening is not None:
        curve = {"coefficients": hardening.coefficients, "longest": hardening.longest, "sd": hardening.sd}
    with atomic_write(path) as temporary:
        temporary.write_text(json.dumps({"geometry": geometry, "hardening": curve}, indent=1))


def read_calibration(path: str | Path, geometry: Geometry) -> tuple[Calibration | None, Hardening | None]:
    """Read what was found of the scan whose ``geometry`` was told."""
    path = checked_file(path)
    calibration = hardening = None
    try:
        data = json.loads(path.read_text())
        told, curve = data["geometry"], data["hardening"]
        if told is not None:
            rows = tuple(
                Correction(r["name"], float(r["value"]), math.inf if r["sd"] is None else float(r["sd"]))
                for r in told["corrections"]
            )
            residuals = (float(told["residual_before"]), float(told["residual_after"]))
            calibration = Calibration(corrected(geometry, {c.name: c.value for c in rows}), rows, residuals)
        if curve is not None:
            coefficients = tuple(float(c) for c in curve["coefficients"])
            hardening = Hardening(coefficients, float(curve["longest"]), float(curve["sd"]))
    except (ValueError, KeyError, TypeError) as error:
        raise InputError(str(path), f"it holds no calibration: {error}", "write it with write_calibration") from error
    return calibration, hardening
