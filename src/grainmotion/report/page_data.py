"""The page's data: one record, which ``assets/*.js`` draw."""

from __future__ import annotations

import json
from collections.abc import Sequence

import numpy as np

from grainmotion._typing import Float
from grainmotion.model.motion_table import MOTION_COLUMNS, STRAIN_COLUMNS
from grainmotion.model.motions import Motions, Status
from grainmotion.model.progress import counted, detail
from grainmotion.report.data import ReportData, StateReport
from grainmotion.report.embedding import Embedded, embed, embed_json
from grainmotion.report.fit_record import fit_record
from grainmotion.report.grain_rows import GrainRows, grain_rows
from grainmotion.report.quantities import quantity_records
from grainmotion.report.radiographs import RADIOGRAPH_CHARACTERS, radiograph_records
from grainmotion.report.scene_record import scene_record
from grainmotion.report.series_coding import embed_series, embed_sizes
from grainmotion.report.slices import slice_records
from grainmotion.report.statuses import status_records
from grainmotion.report.surfaces import surface_record
from grainmotion.report.tables import length_decimals
from grainmotion.report.weak_directions import weak_directions

NO_STATUS = 255  # of a grain that a state does not have
PAGE_CHARACTERS = 15_000_000
"""Of the whole page: the radiographs get what the rest leaves."""
ROUND_CHARACTERS = 1_000_000
"""Scripts, styles and what the templates write."""
LEAST_RADIOGRAPHS = 1_500_000
"""Characters for the radiographs however many grains there are."""
ANGLE_STEP, STRAIN_STEP = 1e-5, 1e-6  # degrees; the page writes 0.001° and 0.0001, rounded as the files do
SD_PRECISION, RESIDUAL_PRECISION = 2e-3, 2e-4


def page_data(data: ReportData) -> dict[str, object]:
    """All that the page's scripts need, as plain data for JSON.

    Parameters
    ----------
    data : ReportData
        The content of the report.

    Returns
    -------
    dict
        ``title``, ``voxel_size`` (mm or None), ``grains`` (labels, centres, diameters), ``surfaces``, ``scene``,
        ``statuses``, ``quantities``, ``slices`` of the reference, ``columns`` and ``weak`` (directions) of all states
        together, and ``states``.  Rows of every state are those of ``grains.labels``, NaN where a state lacks a grain.
    """
    detail("grains and slices", 0, 3)
    rows = grain_rows(data)
    voxel_size = _voxel_size(data)
    decimals = 3 if voxel_size is None else length_decimals(voxel_size)
    record: dict[str, object] = {
        "title": data.title,
        "voxel_size": voxel_size,
        "length_decimals": decimals,
        "grains": {
            "labels": [int(label) for label in rows.labels],
            "centers": embed(rows.centers),
            "diameters": None if rows.diameters is None else embed(rows.diameters),
        },
        "surfaces": _surfaces(data, rows),
        "scene": scene_record(data),
        "statuses": status_records(),
        "quantities": quantity_records(any(state.motions.strains is not None for state in data.states)),
        "reconstruction_errors": [float(e) if np.isfinite(e) else None for e in data.reconstruction_errors],
        "slices": None if data.volume is None else slice_records(data.volume, data.labels, rows.labels),
        "columns": _columns(data.states, rows, 10.0 ** -(decimals + 2)),
        "weak": weak_directions([rows.spread(s.motions.labels, s.motions.covariances, np.nan) for s in data.states]),
    }
    detail("states", 1, 3)
    states = [_state(state, rows) for state in counted(data.states)]
    detail("radiographs", 2, 3)
    left = PAGE_CHARACTERS - ROUND_CHARACTERS - len(json.dumps([record, states]))
    views = radiograph_records(data.states, int(np.clip(left, LEAST_RADIOGRAPHS, RADIOGRAPH_CHARACTERS)))
    return record | {"states": [state | {"views": views[k]} for k, state in enumerate(states)]}


def _surfaces(data: ReportData, rows: GrainRows) -> dict[str, object] | None:
    """Shapes of the grains; None without labels, where the page draws balls."""
    if data.labels is None or data.volume is None:
        return None
    return surface_record(data.labels, data.volume, rows.labels, rows.centers)


def _voxel_size(data: ReportData) -> float | None:
    if data.volume is not None:
        return data.volume.voxel_size
    return data.states[0].voxel_size if data.states else None


def _state(state: StateReport, rows: GrainRows) -> dict[str, object]:
    motions = state.motions
    order = {status.value: k for k, status in enumerate(Status)}
    statuses = np.array([order[str(status)] for status in motions.statuses], dtype=np.uint8)
    return {
        "name": state.name,
        "time": state.time if state.time is not None and np.isfinite(state.time) else None,
        "grains": len(motions),
        "columns": _names(motions),
        "status": embed(rows.spread(motions.labels, statuses, NO_STATUS)),
        "ok": {
            "translation": embed(rows.spread(motions.labels, motions.ok_translation, False)),
            "rotation": embed(rows.spread(motions.labels, motions.ok_rotation, False)),
        },
        "reasons": _reasons(motions, rows),
        "fit": embed_json(fit_record(state)),
    }


def _names(motions: Motions) -> list[str]:
    """Columns of ``motions.csv`` that hold the state's numbers, from ``ux`` on."""
    return [*MOTION_COLUMNS[5:], *(STRAIN_COLUMNS if motions.strains is not None else ())]


def _columns(states: Sequence[StateReport], rows: GrainRows, step: float) -> dict[str, Embedded]:
    """The numbers of ``motions.csv`` of all states, mm and degrees, as fine as can matter."""
    values: dict[str, Float] = {}
    for k, state in enumerate(states):
        table = state.motions.to_table()
        for name in _names(state.motions):
            column = values.setdefault(name, np.full((len(states), len(rows.labels)), np.nan))
            column[k] = rows.spread(state.motions.labels, table[name].to_numpy(float), np.nan)
    return {name: _coded(name, column, step) for name, column in values.items()}


def _coded(name: str, values: Float, length_step: float) -> Embedded:
    if name.startswith("sd_"):
        return embed_sizes(values, SD_PRECISION)
    if name == "residual":
        return embed_sizes(values, RESIDUAL_PRECISION)
    steps = {"u": length_step, "w": ANGLE_STEP, "e": STRAIN_STEP}
    return embed_series(values, 1.0 if name == "iterations" else steps[name[0]])


def _reasons(motions: Motions, rows: GrainRows) -> Embedded:
    """Cause and remedy of the grains that have one, by row."""
    pairs = zip(rows.of(motions.labels), motions.reasons, strict=True)
    return embed_json({str(row): reason for row, reason in pairs if reason})
