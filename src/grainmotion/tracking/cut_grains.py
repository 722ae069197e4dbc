"""Grains that are seen in part: the border of the reference's field cuts them, or the panel in a later state."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from grainmotion.model.pose import Pose
from grainmotion.objective.evaluation import Evaluation
from grainmotion.objective.residual import StateProblem
from grainmotion.projection.grain_arrays import planar

CUT_PIXELS = 0.5
"""Pixels by which a grain may reach beyond the panel without being cut."""


def cut_by_panel(problem: StateProblem, pose: Pose, evaluation: Evaluation) -> NDArray[np.bool_]:
    """Grains ``(n,)`` of which a view sees a part: some of their surface lies off the panel, and some on it."""
    grains, geometry, seen = problem.grains, problem.target.scan.geometry, evaluation.patches.seen
    found: NDArray[np.bool_] = np.any((seen > 0) & (seen < 1), axis=1)  # footprints reach a little beyond the grains
    rows = np.flatnonzero(found)
    if not len(rows):
        return found
    surfaces = np.einsum("nij,nkj->nki", pose.matrices[rows], grains.hulls[rows])
    points = surfaces + (grains.centers + pose.translations)[rows, None]
    pixels = geometry.project_points(points).reshape(len(geometry), *points.shape[:2], 2)
    inside = (pixels > -0.5 - CUT_PIXELS) & (pixels < np.array(geometry.shape) - 0.5 + CUT_PIXELS)
    on = inside[..., 1] if planar(grains, geometry) else np.all(inside, axis=-1)  # a slice has one row
    found[rows] = np.any(np.any(on, axis=2) & ~np.all(on, axis=2), axis=0)
    return found


def cut_reason(in_reference: bool, in_state: bool) -> str:
    """Why a grain is not whole; empty if it is."""
    if in_reference:
        return "the border of the reference's field cuts it, and its shape beyond is not known; tracked as far as seen"
    if in_state:
        return "the panel cuts it in this state; tracked as far as seen"
    return ""
