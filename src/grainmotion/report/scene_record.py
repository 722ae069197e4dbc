"""What is drawn beside the grains in 3-D: the field of view and the bodies of the reference."""

from __future__ import annotations

import numpy as np

from grainmotion._typing import Float
from grainmotion.model.state_fit import StateFit
from grainmotion.model.volume import Volume
from grainmotion.report.body_surfaces import body_meshes
from grainmotion.report.data import ReportData
from grainmotion.report.surfaces import mesh_record


def scene_record(data: ReportData) -> dict[str, object]:
    """For the page: ``box``, lowest and highest corner of the reference volume (mm, x y z) or None, and ``bodies``.

    A body has its name, its centre (mm), and its motion in each state: u (mm) and rotation vector (radians) about the
    centre, None where it did not move.  ``surfaces`` (`surfaces.mesh_record`) are those of the bodies, in their order.
    """
    shown = [body for body in data.bodies if body.kind != "rest"]
    bodies = [
        {
            "name": body.name,
            "center": [float(c) for c in body.center],
            "motions": [_motion(state.motions.fit, body.name) for state in data.states],
        }
        for body in shown
    ]
    return {
        "box": None if data.volume is None else list(_corners(data.volume)),
        "bodies": bodies,
        "surfaces": mesh_record(body_meshes(shown)) if shown else None,
    }


def _motion(fit: StateFit, name: str) -> list[float] | None:
    for body in fit.bodies:
        if body.name == name and body.moved:
            return [float(value) for value in (*body.translation, *body.rotation)]
    return None


def _corners(volume: Volume) -> tuple[list[float], list[float]]:
    """Lowest and highest corner of a volume, at the faces of its outer voxels, mm, x y z."""
    half: Float = np.array(volume.shape[::-1]) * volume.voxel_size / 2
    low, high = np.asarray(volume.center) - half, np.asarray(volume.center) + half
    return [round(float(v), 6) for v in low], [round(float(v), 6) for v in high]
