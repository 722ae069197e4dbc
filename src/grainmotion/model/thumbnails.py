"""Small pictures for notebooks: images as PNG, points, arrows and curves as SVG; at most a few kilobytes each."""

from __future__ import annotations

import base64
import io
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from grainmotion._typing import Float

PICTURE_EDGE = 132
"""Width or height of a picture, the larger of them, CSS pixels."""
MAX_POINTS = 180
"""Grains or views in a picture."""
LINE, ACCENT = "#2f7ed8", "#d9722e"


def thinned_image(image: NDArray[np.floating]) -> NDArray[np.floating]:
    """Every k-th row and column, so that nothing large is touched."""
    step = max(1, -(-max(image.shape) // PICTURE_EDGE))
    return np.asarray(image[::step, ::step])


def grey_picture(image: NDArray[np.floating], *, upwards: bool) -> str:
    """A grey ``<img>`` of an image; with ``upwards``, row 0 is at the bottom."""
    from PIL import Image  # takes a while to load, which nobody but a notebook needs

    small = thinned_image(image).astype(float)
    small = small[::-1] if upwards else small
    low, high = (float(q) for q in np.percentile(small, [0.5, 99.5])) if small.size else (0.0, 1.0)
    grey = np.clip((small - low) / (high - low if high > low else 1.0) * 255, 0, 255).astype(np.uint8)
    stream = io.BytesIO()
    Image.fromarray(grey).save(stream, "PNG")
    scale = PICTURE_EDGE / max(small.shape)
    width, height = (max(1, round(scale * n)) for n in small.shape[::-1])
    data = base64.b64encode(stream.getvalue()).decode()
    look = "image-rendering:pixelated;border-radius:3px"
    return f'<img alt="" width="{width}" height="{height}" style="{look}" src="data:image/png;base64,{data}">'


def circles_picture(places: Float, radii: Float, colours: Sequence[str]) -> str:
    """Circles in a plane, the second coordinate upwards; at most `MAX_POINTS` of them."""
    rows = _thinned_rows(len(places))
    place, scale, size = _frame(places[rows], float(np.max(radii[rows], initial=0.0)))
    shapes = [
        f'<circle cx="{x:.1f}" cy="{y:.1f}" r="{max(1.0, scale * radii[k]):.1f}" fill="{colours[k]}" '
        f'fill-opacity=".4" stroke="{colours[k]}"/>'
        for k, (x, y) in zip(rows, place, strict=True)
    ]
    return _svg(size, shapes)


def arrows_picture(starts: Float, vectors: Float, colours: Sequence[str]) -> str:
    """Arrows in a plane, the longest of which spans a fifth of it; NaN ones are points."""
    rows = _thinned_rows(len(starts))
    extent = float(np.ptp(starts, axis=0).max()) if len(starts) else 1.0
    longest = float(np.nanmax(np.linalg.norm(vectors, axis=1), initial=0.0)) if len(vectors) else 0.0
    ends = starts + np.nan_to_num(vectors) * (0.2 * (extent or 1.0) / longest if longest > 0 else 0.0)
    both, _, size = _frame(np.concatenate([starts[rows], ends[rows]]), 0.03 * (extent or 1.0))
    shapes = []
    for k, (x0, y0), (x1, y1) in zip(rows, both[: len(rows)], both[len(rows) :], strict=True):
        shapes.append(f'<circle cx="{x0:.1f}" cy="{y0:.1f}" r="2" fill="{colours[k]}"/>')
        if (x1 - x0) ** 2 + (y1 - y0) ** 2 > 1:
            line = f'x1="{x0:.1f}" y1="{y0:.1f}" x2="{x1:.1f}" y2="{y1:.1f}"'
            shapes.append(f'<line {line} stroke="{colours[k]}" stroke-width="1.5" marker-end="url(#gm-tip)"/>')
    tip = (
        '<defs><marker id="gm-tip" orient="auto" markerWidth="4" markerHeight="4" refX="2" refY="2">'
        '<path d="M0,0 L4,2 L0,4 z" fill="context-stroke"/></marker></defs>'
    )
    return _svg(size, [tip, *shapes])


def curve_picture(values: Float) -> str:
    """A curve of positive values, logarithmic."""
    known = values[np.isfinite(values) & (values > 0)]
    if len(known) < 2:
        return ""
    logs = np.log(known[_thinned_rows(len(known))])
    spread = float(np.ptp(logs)) or 1.0
    x, y = np.linspace(6, PICTURE_EDGE - 6, len(logs)), 6 + (logs.max() - logs) / spread * (0.6 * PICTURE_EDGE - 12)
    points = " ".join(f"{a:.1f},{b:.1f}" for a, b in zip(x, y, strict=True))
    line = f'<polyline points="{points}" fill="none" stroke="{LINE}" stroke-width="1.8"/>'
    return _svg((PICTURE_EDGE, 0.6 * PICTURE_EDGE), [line])


def scan_picture(towards_source: Float) -> str:
    """A scan from above: the sample, the source of each view by the angle of its direction (radians), view 0 larger."""
    middle, radius = PICTURE_EDGE / 2, 0.42 * PICTURE_EDGE
    shapes = [
        f'<circle cx="{middle}" cy="{middle}" r="{0.14 * PICTURE_EDGE:.1f}" fill="currentColor" fill-opacity=".2"/>'
    ]
    for k in _thinned_rows(len(towards_source)):
        x, y = middle + radius * np.cos(towards_source[k]), middle - radius * np.sin(towards_source[k])
        if k == 0:
            ends = [2 * middle - x, 2 * middle - y]
            across = 0.16 * PICTURE_EDGE * np.array([np.sin(towards_source[0]), np.cos(towards_source[0])])
            panel = f'x1="{ends[0] - across[0]:.1f}" y1="{ends[1] - across[1]:.1f}"'
            panel += f' x2="{ends[0] + across[0]:.1f}" y2="{ends[1] + across[1]:.1f}"'
            shapes.append(f'<line {panel} stroke="currentColor" stroke-width="3"/>')
        shapes.append(
            f'<circle cx="{x:.1f}" cy="{y:.1f}" r="{4.5 if k == 0 else 2}" fill="{ACCENT if k == 0 else LINE}"/>'
        )
    return _svg((PICTURE_EDGE, PICTURE_EDGE), shapes)


def _thinned_rows(count: int) -> list[int]:
    return list(range(0, count, max(1, -(-count // MAX_POINTS))))


def _frame(points: Float, room: float) -> tuple[Float, float, tuple[float, float]]:
    """Points in pixels with y downwards, pixels a unit, and width and height of the picture."""
    if not len(points):
        return points, 1.0, (PICTURE_EDGE, PICTURE_EDGE)
    low, high = np.nanmin(points, axis=0) - room, np.nanmax(points, axis=0) + room
    spans = np.maximum(high - low, 1e-9 + 0.15 * float((high - low).max()))
    scale = (PICTURE_EDGE - 8) / float(spans.max())
    middle = (low + high) / 2
    width, height = 8 + scale * spans
    placed = np.stack(
        [width / 2 + scale * (points[:, 0] - middle[0]), height / 2 - scale * (points[:, 1] - middle[1])], axis=1
    )
    return placed, scale, (float(width), float(height))


def _svg(size: tuple[float, float], shapes: Sequence[str]) -> str:
    width, height = (round(n) for n in size)
    box = f'width="{width}" height="{height}" viewBox="0 0 {width} {height}"'
    return f'<svg xmlns="http://www.w3.org/2000/svg" role="img" aria-hidden="true" {box}>{"".join(shapes)}</svg>'
