"""The page's data: one record, which ``assets/*.js`` draw."""

from __future__ import annotations

import numpy as np

from grainmotion._typing import Float
from grainmotion.model.motion_table import MOTION_COLUMNS, STRAIN_COLUMNS
from grainmotion.model.motions import Motions, Status
from grainmotion.report.data import ReportData, StateReport
from grainmotion.report.embedding import Embedded, embed, embed_json, rounded
from grainmotion.report.fit_record import fit_record
from grainmotion.report.grain_rows import GrainRows, grain_rows
from grainmotion.report.quantities import quantity_records
from grainmotion.report.radiographs import radiograph_records
from grainmotion.report.scene_record import scene_record
from grainmotion.report.slices import slice_records
from grainmotion.report.statuses import status_records
from grainmotion.report.surfaces import surface_record
from grainmotion.report.tables import length_decimals
from grainmotion.report.weak_directions import weak_directions

NO_STATUS = 255  # of a grain that a state does not have
VALUE_DIGITS, SD_DIGITS = 6, 3


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
        ``statuses``, ``quantities``, ``slices`` of the reference and ``states``.  Rows of every state are those of
        ``grains.labels``, NaN where a state lacks a grain.
    """
    rows = grain_rows(data)
    views = radiograph_records(data.states)
    voxel_size = _voxel_size(data)
    return {
        "title": data.title,
        "voxel_size": voxel_size,
        "length_decimals": 3 if voxel_size is None else length_decimals(voxel_size),
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
        "states": [_state(state, rows) | {"views": views[k]} for k, state in enumerate(data.states)],
    }


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
    covariances = rows.spread(motions.labels, motions.covariances, np.nan)
    return {
        "name": state.name,
        "time": state.time if state.time is not None and np.isfinite(state.time) else None,
        "grains": len(motions),
        "columns": {name: embed(rows.spread(motions.labels, c, np.nan)) for name, c in _columns(motions).items()},
        "status": embed(rows.spread(motions.labels, statuses, NO_STATUS)),
        "ok": {
            "translation": embed(rows.spread(motions.labels, motions.ok_translation, False)),
            "rotation": embed(rows.spread(motions.labels, motions.ok_rotation, False)),
        },
        "reasons": _reasons(motions, rows),
        "weak": weak_directions(covariances),
        "fit": embed_json(fit_record(state)),
    }


def _columns(motions: Motions) -> dict[str, Float]:
    """The numbers of ``motions.csv`` from ``ux`` on, mm and degrees, rounded to what can matter."""
    table = motions.to_table()
    names = [*MOTION_COLUMNS[5:], *(STRAIN_COLUMNS if motions.strains is not None else ())]
    return {
        name: rounded(table[name].to_numpy(float), SD_DIGITS if name.startswith("sd_") else VALUE_DIGITS)
        for name in names
    }


def _reasons(motions: Motions, rows: GrainRows) -> Embedded:
    """Cause and remedy of the grains that have one, by row."""
    pairs = zip(rows.of(motions.labels), motions.reasons, strict=True)
    return embed_json({str(row): reason for row, reason in pairs if reason})
