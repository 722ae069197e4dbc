"""Initial guess: the start poses, then one rigid body, then a smooth displacement field."""

from __future__ import annotations

import numpy as np

from grainmotion._typing import Float, Image
from grainmotion.errors import InputError
from grainmotion.model.grains import GrainSet
from grainmotion.model.motions import Motions
from grainmotion.model.pose import Pose
from grainmotion.objective import displacement_bases
from grainmotion.objective.residual import Basis, StateProblem
from grainmotion.rotations import recenter, rotation_matrix
from grainmotion.solvers.gauss_newton import Solution
from grainmotion.tracking.multiresolution import FIELD_GRAIN_PIXELS
from grainmotion.tracking.multistage import INITIAL_STOPPING, MultistageFit
from grainmotion.uncertainty.goodness_of_fit import misfits


def starting_pose(grains: GrainSet, start: Motions | None) -> Pose:
    """The pose of ``grains`` in ``start``, matched by label; unknown grains follow the mean of the others."""
    n = len(grains)
    pose = Pose(np.zeros((n, 3)), np.broadcast_to(np.eye(3), (n, 3, 3)).copy())
    if start is None:
        return pose
    rows = {int(label): k for k, label in enumerate(start.labels)}
    missing = [int(label) for label in grains.labels if int(label) not in rows]
    if missing:
        raise InputError("start", f"grains {missing[:5]} have no row", "give the motions of the same reference")
    order = [rows[int(label)] for label in grains.labels]
    translations, rotations = start.translations[order], start.rotations[order]
    known = np.all(np.isfinite(np.hstack([translations, rotations])), axis=1)
    if not known.any():
        return pose
    # The start's centres may differ from ours by what another segmentation cut off.
    matrices = rotation_matrix(np.where(known[:, None], rotations, 0.0))
    shifted = recenter(matrices, np.nan_to_num(translations), start.centers[order], grains.centers)
    return Pose(np.where(known[:, None], shifted, shifted[known].mean(axis=0)), matrices)


def centroid_shift(problem: StateProblem, pose: Pose) -> Pose:
    """All grains shifted as the centroids of measured and simulated radiographs tell, least squares over views."""
    target, geometry = problem.target, problem.target.scan.geometry
    evaluation = problem.evaluate(pose)
    middle = (problem.grains.centers + pose.translations).mean(axis=0)
    step = problem.grains.voxel_size
    spots = geometry.project_points(np.vstack([middle, middle + step * np.eye(3)]))
    if not np.isfinite(spots).all():  # the start lies behind a source
        return pose
    slopes = (spots[:, 1:] - spots[:, :1]).transpose(0, 2, 1).reshape(-1, 3) / step
    simulated = evaluation.line_integrals - target.fixed_background
    gaps = _centroids(target.filtered(simulated + evaluation.raw_residual)) - _centroids(target.filtered(simulated))
    shift = np.linalg.lstsq(slopes, gaps.ravel(), rcond=1e-3)[0]
    return pose.moved(pose.translations + shift, pose.matrices)


def _centroids(images: Image) -> Float:
    """Mass centres (row, column) of radiographs, ``(views, 2)``."""
    mass = np.maximum(images.sum(axis=(1, 2), dtype=float), 1e-12)
    rows = (images.sum(axis=2, dtype=float) @ np.arange(images.shape[1])) / mass
    columns = (images.sum(axis=1, dtype=float) @ np.arange(images.shape[2])) / mass
    return np.stack([rows, columns], axis=1)


MAX_MISREGISTERED_AT_START = 0.1  # share of badly fitting grains from which another start is tried


def initialise(fit: MultistageFit, pose: Pose) -> tuple[Pose, Pose]:
    """A smooth field's pose, and the pose from which the free stages start well.

    A smooth field that carries the sample far can mislead grains that moved little and each its own way,
    so a field is kept only if the grains then fit, else one body and the plain start are tried as well.
    """
    if not fit.settings.fields:
        return pose, pose
    width = fit.settings.filters[0]
    problem = StateProblem(*fit.level(width))
    judged = StateProblem(
        fit.grains, fit.filtered_target(width, fit.settings.response_model.without_hardening)
    )  # a drift is no misfit
    best: Solution[Pose] | None = None
    fields = smooth_fields(fit, pose)
    for candidate in [*reversed(fields), pose]:
        end = fit.solve(problem, candidate, fit.coarse_stopping(), f"free, filter {width:g}")
        if best is None or end.costs[-1] < best.costs[-1]:
            best = end
        evaluation = judged.evaluate(best.state)
        if (
            misfits(judged, evaluation).misregistered_in_crowd & evaluation.patches.seen.any(axis=1)
        ).mean() < MAX_MISREGISTERED_AT_START:
            break
    assert best is not None
    return fields[-1], best.state


def smooth_fields(fit: MultistageFit, pose: Pose) -> list[Pose]:
    """One rigid body from the better of two starts, then smooth fields if there are grains enough for them."""
    width = fit.settings.field_filter
    grains, target = fit.level(width, least=FIELD_GRAIN_PIXELS)
    problem = StateProblem(grains, target, displacement_bases.rigid)
    starts = [pose, centroid_shift(problem, pose)]
    ends = [fit.solve(problem, s, INITIAL_STOPPING, "one body") for s in starts]
    poses = [min(ends, key=lambda e: e.costs[-1]).state]
    fields: list[tuple[str, Basis, int]] = [
        ("affine field", displacement_bases.affine, 6),
        ("quadratic field", displacement_bases.quadratic, 20),
    ]
    for name, basis, needed in fields:
        if len(fit.grains) >= needed:
            problem = StateProblem(grains, target, basis)
            poses.append(fit.solve(problem, poses[-1], INITIAL_STOPPING, name).state)
    return poses
