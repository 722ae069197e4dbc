"""Grains that are seen in part: the border of the reference's field cuts them, or the panel in a later state."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from grainmotion._typing import Float
from grainmotion.model.geometry import Geometry
from grainmotion.model.pose import Pose
from grainmotion.objective.evaluation import Evaluation
from grainmotion.objective.residual import StateProblem
from grainmotion.projection.grain_arrays import planar

MIN_SHADOW, WHOLE_SHADOW = 0.02, 0.98
"""Shares of a grain's attenuation on the panel in one view between which that view cuts it: 2 % are a cap of 1.7 voxels
of a grain of 20.  Voxels of its rim reach 2 to 9 voxels beyond its surface, so its outline does not tell."""


def cut_by_panel(problem: StateProblem, pose: Pose, evaluation: Evaluation) -> NDArray[np.bool_]:
    """Grains ``(n,)`` of which a view shows a part: some of their attenuation falls on the panel, and some beside it.

    The line integrals of a grain over the cross-sections of its pixels at its place add up to its attenuation.
    """
    grains, seen = problem.grains, evaluation.patches.seen
    found: NDArray[np.bool_] = np.any((seen > 0) & (seen < 1), axis=1)  # footprints reach beyond the grains
    if not found.any() or planar(grains, problem.target.scan.geometry):
        return found & False
    sums = np.zeros(seen.shape)
    for view, (grain, own, _) in zip(evaluation.patches.boxes[:, 1], evaluation.grain_pixels(), strict=True):
        sums[grain, view] += own.sum() if found[grain] else 0
    whole = np.array([grains.voxels_of(row).sum(dtype=float) for row in range(len(grains))])
    shares = sums * _cross_sections(problem.target.scan.geometry, grains.centers + pose.translations).T
    shares /= np.maximum(whole * grains.voxel_size**3, 1e-300)[:, None]
    return found & np.any((shares > MIN_SHADOW) & (shares < WHOLE_SHADOW), axis=1)


def _cross_sections(geometry: Geometry, points: Float) -> Float:
    """Areas ``(views, m)`` of a pixel at points, across the rays, mm²."""
    normals = geometry.normals[:, None]
    if geometry.beam == "parallel":
        ray = np.broadcast_to(geometry.source[:, None], (len(geometry), len(points), 3))
        return np.asarray(np.abs((ray * normals).sum(-1)) / np.linalg.norm(ray, axis=-1))
    ray = points - geometry.source[:, None]
    along = (ray * normals).sum(-1)
    depths = along / (geometry.rays * geometry.normals).sum(1)[:, None]
    return np.asarray(np.abs(along) / np.linalg.norm(ray, axis=-1) * depths**2)


def cut_reason(in_reference: bool, in_state: bool) -> str:
    """Why a grain is not whole; empty if it is."""
    if in_reference:
        return "the border of the reference's field cuts it, and its shape beyond is not known; tracked as far as seen"
    if in_state:
        return "the panel cuts it in this state; tracked as far as seen"
    return ""
