"""The fit of one state as plain data: facts, notes, small tables and the curve of its residual."""

from __future__ import annotations

import math

from grainmotion.report import tables
from grainmotion.report.data import StateReport

MOTION_HEADS = ("ux (mm)", "uy (mm)", "uz (mm)", "ωx (°)", "ωy (°)", "ωz (°)")


def fit_record(state: StateReport) -> dict[str, object]:
    """``facts``, ``notes``, ``tables`` and ``costs`` (stages with their relative residuals, None where not finite)."""
    fit = state.motions.fit
    made = [
        _table(
            "Poses of the views",
            "What the fit corrected: shift of the panel along its rows and columns, and the stage’s angle.",
            ("view", "along u (pixels)", "along v (pixels)", "angle (°)"),
            [[view, *values] for view, values in tables.correction_rows(fit, state.views)],
        ),
        _table(
            "Bodies beside the grains",
            "Pistons, walls and other bodies that move as one.",
            ("body", "what it did", *MOTION_HEADS),
            [[name, moved, *values] for name, moved, values in tables.body_rows(state)],
        ),
        _table(
            "Grains that appeared",
            "Grains of this state that the reference does not have, as ellipsoids.",
            ("number", "x (mm)", "y (mm)", "z (mm)", "radius (mm)", "attenuation (1/mm)"),
            [[name, *values] for name, values in tables.appeared_rows(state)],
        ),
        _table(
            "Pieces of broken grains",
            "Motion of each piece from where it was in the reference.",
            ("grain", "status", "share", *MOTION_HEADS),
            [[name, status, *values] for name, status, values in tables.piece_rows(state)],
        ),
        _table("Comparison", "With the truth or another measurement.", (), [list(row) for row in state.comparison]),
    ]
    return {
        "facts": [list(row) for row in tables.fit_facts(state)],
        "notes": list(fit.notes),
        "tables": [table for table in made if table["rows"]],
        "costs": _stages(fit.costs),
    }


def _table(title: str, caption: str, head: tuple[str, ...], rows: list[list[str]]) -> dict[str, object]:
    return {"title": title, "caption": caption, "head": list(head), "rows": rows}


def _stages(costs: tuple[tuple[str, float], ...]) -> list[dict[str, object]]:
    """The relative residuals by stage, in order."""
    stages: list[dict[str, object]] = []
    for name, cost in costs:
        if not stages or stages[-1]["name"] != name:
            stages.append({"name": name, "values": []})
        values = stages[-1]["values"]
        assert isinstance(values, list)
        values.append(cost if math.isfinite(cost) else None)
    return stages
