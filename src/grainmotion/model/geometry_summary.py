"""What a geometry shows of itself in a terminal and in a notebook."""

from __future__ import annotations

import numpy as np

from grainmotion._typing import Beam, Float
from grainmotion.model.summary import Summary, shape_text
from grainmotion.model.thumbnails import scan_picture

MAX_LISTED_ANGLES = 8


def views_summary(vectors: Float, shape: tuple[int, int], beam: Beam, angles_deg: Float) -> Summary:
    """Beam, angles, panel and distances of the views ``vectors (n, 12)``, and a picture of them from above."""
    source, panel, u, v = vectors.reshape(-1, 4, 3).transpose(1, 0, 2)
    rays = panel - source if beam == "cone" else source
    names = [f"{angle:.5g}°" for angle in angles_deg[:MAX_LISTED_ANGLES]]
    if len(angles_deg) > MAX_LISTED_ANGLES:
        names = [*names[:3], "…", f"{angles_deg[-1]:.5g}°"]
    pixel = float(np.linalg.norm(u, axis=1).mean() + np.linalg.norm(v, axis=1).mean()) / 2
    side = "lowest" if float(v[:, 2].mean()) >= 0 else "highest"
    rows = [
        ("beam", beam),
        ("views", f"{len(vectors)}: {', '.join(names)}"),
        ("panel", f"{shape_text(shape)} pixels of {pixel:.4g} mm, row 0 is the {side}"),
    ]
    if beam == "cone":
        normal = np.cross(u[0], v[0])
        normal /= np.linalg.norm(normal)
        to_axis, to_panel = abs(float(source[0] @ normal)), abs(float(rays[0] @ normal))
        rows.append(("source", f"{to_axis:.5g} mm to the axis, {to_panel:.5g} mm to the panel"))
    line = f"{beam} beam, {len(vectors)} view{'s' if len(vectors) > 1 else ''} of {shape_text(shape)} pixels"
    return Summary("Geometry", line, tuple(rows), scan_picture(np.arctan2(-rays[:, 1], -rays[:, 0])))
