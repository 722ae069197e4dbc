"""Arrows at the grains' centres in three dimensions, as a plotly figure (plain data, no plotly objects)."""

from __future__ import annotations

import math

import numpy as np

from grainmotion._typing import Float, Index
from grainmotion.model.motions import Motions
from grainmotion.report.tables import STATUS_COLOURS, number

ARROW_COLOUR_SCALE = "Viridis"
ARROW_HEAD_SHARE = 0.5  # of the arrow's length
ARROW_LENGTH_SHARE = 0.2  # of the sample's size, for the longest arrow
MIN_EXTENT_VOXELS = 20  # of a sample whose grains lie on one point


def scenes(motions: Motions, voxel_size: float, max_grains: int) -> dict[str, object]:
    """Markers at the centres of at most ``max_grains`` grains, and a figure for each kind of arrow."""
    step = max(1, math.ceil(len(motions) / max(1, max_grains)))
    rows = np.arange(0, len(motions), step)
    u, degrees = motions.translations, np.rad2deg(motions.rotations)
    measured = np.isfinite(u).all(axis=1)
    mean = u[measured].mean(axis=0) if measured.any() else np.zeros(3)
    kinds = {
        "Displacement u (mm)": (u, "|u| (mm)"),
        "Displacement less its mean over grains (mm)": (u - mean, "|u − mean| (mm)"),
        "Rotation vector ω (°)": (degrees, "|ω| (°)"),
    }
    centers = motions.centers[rows]
    arrows = {kind: scene(centers, v[rows], unit, voxel_size) for kind, (v, unit) in kinds.items()}
    note = f", {len(rows)} of {len(motions)} grains" if step > 1 else ""
    return {"grains": _grains(motions, rows), "arrows": arrows, "note": note}


def scene(starts: Float, vectors: Float, unit: str, voxel_size: float) -> dict[str, object]:
    """Arrows ``vectors (n, 3)`` from ``starts (n, 3)``, as the data and layout of a plotly figure."""
    measured = np.isfinite(vectors).all(axis=1)
    centers, arrows = starts[measured], vectors[measured]
    length = np.linalg.norm(arrows, axis=1)
    factor = _magnification(starts, length, voxel_size)
    tips = centers + factor * arrows
    top = float(length.max(initial=0)) or 1.0
    shafts = np.stack([centers, tips, np.full_like(tips, np.nan)], axis=1).reshape(-1, 3)
    colour = {"colorscale": ARROW_COLOUR_SCALE, "cmin": 0.0, "cmax": top}
    bar = {"title": {"text": unit}, "thickness": 14, "len": 0.7}
    data: list[dict[str, object]] = [
        {
            "type": "scatter3d",
            "mode": "lines",
            **_xyz(shafts),
            "line": {"width": 5, "color": _rounded(np.repeat(length, 3)[None])[0], **colour},
            "hoverinfo": "skip",
            "showlegend": False,
        },
        {
            "type": "cone",
            **_xyz(tips),
            **dict(zip("uvw", _rounded((ARROW_HEAD_SHARE * factor * arrows).T))),
            "sizemode": "raw",
            "sizeref": 1.0,
            "anchor": "tip",
            "colorscale": ARROW_COLOUR_SCALE,
            "cmin": 0.0,
            "cmax": ARROW_HEAD_SHARE * factor * top,
            "showscale": False,
            "hoverinfo": "skip",
        },
        {  # carries the colour bar in the arrows' own unit
            "type": "scatter3d",
            "mode": "markers",
            **_xyz(centers[:1]),
            "marker": {"size": 0.1, "color": [0.0] * len(centers[:1]), "showscale": True, "colorbar": bar, **colour},
            "hoverinfo": "skip",
            "showlegend": False,
        },
    ]
    layout = {
        "scene": {
            "aspectmode": "data",
            **{f"{a}axis": {"title": {"text": f"{a} (mm)"}, "showbackground": False} for a in "xyz"},
            "camera": {"eye": _camera(np.vstack([starts, tips]))},
        },
        "margin": {"l": 0, "r": 0, "t": 8, "b": 0},
        "legend": {"x": 0.01, "y": 0.99, "bgcolor": "rgba(0,0,0,0)", "itemsizing": "constant"},
        "uirevision": "keep",
    }
    return {"data": data if len(centers) else [], "layout": layout, "note": f"arrows × {factor:g}"}


def _grains(motions: Motions, shown: Index) -> list[dict[str, object]]:
    """Markers at the centres, one trace a status, with the grain's motion as the text shown on hovering."""
    traces: list[dict[str, object]] = []
    for status, colour in STATUS_COLOURS.items():
        rows = shown[motions.statuses[shown] == status]
        if len(rows) == 0:
            continue
        hover = [
            f"grain {motions.labels[i]} · {status}<br>u = {_triple(motions.translations[i], 4)} mm"
            f"<br>ω = {_triple(np.rad2deg(motions.rotations[i]), 3)} °"
            for i in rows
        ]
        traces.append(
            {
                "type": "scatter3d",
                "mode": "markers",
                "name": status,
                **_xyz(motions.centers[rows]),
                "marker": {"size": 3, "color": colour},
                "text": hover,
                "hoverinfo": "text",
            }
        )
    return traces


def _magnification(centers: Float, length: Float, voxel_size: float) -> float:
    """Round factor by which the longest arrow spans about a fifth of the sample; 1 if that is right within 2."""
    longest = float(length.max(initial=0))
    if longest == 0:
        return 1.0
    extent = max(float(np.ptp(centers, axis=0).max()), MIN_EXTENT_VOXELS * voxel_size)
    wanted = ARROW_LENGTH_SHARE * extent / longest
    if 0.5 <= wanted <= 2:
        return 1.0
    power = 10.0 ** np.floor(np.log10(wanted))
    return float(power * max(m for m in (1, 2, 3, 4, 5, 6, 8) if m * power <= wanted * (1 + 1e-9)))


def _camera(points: Float) -> dict[str, float]:
    """Position of the camera, such that slender samples fit too (plotly scales the box to a volume of 1)."""
    extent = np.maximum(np.ptp(points, axis=0), 1e-12) if len(points) else np.ones(3)
    extent = np.maximum(extent, extent.max() / 50)
    distance = max(1.0, 0.85 * float(extent.max() / np.cbrt(extent.prod())))
    return {"x": 1.3 * distance, "y": -1.5 * distance, "z": 0.6 * distance}


def _xyz(points: Float) -> dict[str, list[float | None]]:
    return dict(zip("xyz", _rounded(points.T)))


def _rounded(rows: Float) -> list[list[float | None]]:
    return [[float(f"{v:.6g}") if np.isfinite(v) else None for v in row] for row in rows]


def _triple(vector: Float, decimals: int) -> str:
    return "(" + ", ".join(number(v, decimals) for v in vector) + ")"
