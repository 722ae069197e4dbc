"""Which of several starts of a state fits its radiographs best: one coarse simulation of each."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from grainmotion._typing import Float
from grainmotion.backends.base import PatchBackend
from grainmotion.backends.device import Device
from grainmotion.model.grains import GrainSet
from grainmotion.model.motions import Motions
from grainmotion.model.scan import Scan
from grainmotion.model.starting_pose import starting_pose
from grainmotion.objective.global_parameters import dot
from grainmotion.objective.residual import StateProblem
from grainmotion.tracking.multistage import MultistageFit
from grainmotion.tracking.settings import TrackSettings

OnBackend = Device | PatchBackend | None
Start = Motions | Sequence[Motions | None] | None
"""Motions to start from, or several of which the best is taken; None is no motion."""


def best_start(
    grains: GrainSet, scan: Scan, starts: Sequence[Motions | None], settings: TrackSettings, device: OnBackend = None
) -> tuple[int, tuple[float, ...]]:
    """Index of the start that fits the radiographs best, the first of equals, and the relative residual of each.

    Compared under the filter of the first free stage, on the same pixels; with the gain fixed, since misplaced grains
    could pass for a gain.  A liquid is left out of all alike.
    """
    poses = [starting_pose(grains, start) for start in starts]
    fit = MultistageFit.coarse(grains, scan, settings, device)
    fit.leave_out_unseen(poses[0])
    problem = StateProblem(*fit.level(settings.filters[0], settings.response_model.while_far))
    norm = dot(problem.target.measured, problem.target.measured) or 1.0
    residuals: Float = np.sqrt([2 * problem.evaluate(pose).cost / norm for pose in poses])
    best = int(np.argmin(np.where(np.isfinite(residuals), residuals, np.inf)))
    return best, tuple(float(residual) for residual in residuals)


def with_start_residuals(motions: Motions, residuals: tuple[float, ...]) -> Motions:
    """The motions, with the residuals of the starts among which theirs was chosen."""
    return replace(motions, fit=replace(motions.fit, start_residuals=residuals)) if residuals else motions
