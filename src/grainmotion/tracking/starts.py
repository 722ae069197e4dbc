"""Where a state's tracking starts: from the motions given, or from the centroids of the radiographs."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from grainmotion import motion
from grainmotion.errors import InputError
from grainmotion.grains import GrainSet
from grainmotion.motions import Motions
from grainmotion.packed import Image, Pose
from grainmotion.tracking.residual import StateProblem

Float = NDArray[np.float64]


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
    matrices = motion.exp(np.where(known[:, None], rotations, 0.0))
    shifted = motion.recenter(matrices, np.nan_to_num(translations), start.centers[order], grains.centers)
    return Pose(np.where(known[:, None], shifted, shifted[known].mean(axis=0)), matrices)


def centroid_shift(problem: StateProblem, pose: Pose) -> Pose:
    """All grains shifted as the centroids of measured and simulated radiographs tell, least squares over views."""
    target, geometry = problem.target, problem.target.scan.geometry
    seen = problem.glance(pose)
    middle = (problem.grains.centers + pose.translations).mean(axis=0)
    step = problem.grains.voxel_size
    spots = geometry.project_points(np.vstack([middle, middle + step * np.eye(3)]))
    if not np.isfinite(spots).all():  # the start lies behind a source
        return pose
    slopes = (spots[:, 1:] - spots[:, :1]).transpose(0, 2, 1).reshape(-1, 3) / step
    simulated = seen.path - target.fixed
    gaps = _centroids(target.filtered(simulated + seen.raw)) - _centroids(target.filtered(simulated))
    shift = np.linalg.lstsq(slopes, gaps.ravel(), rcond=1e-3)[0]
    return pose.moved(pose.translations + shift, pose.matrices)


def _centroids(images: Image) -> Float:
    """Mass centres (row, column) of radiographs, ``(views, 2)``."""
    mass = np.maximum(images.sum(axis=(1, 2), dtype=float), 1e-12)
    rows = (images.sum(axis=2, dtype=float) @ np.arange(images.shape[1])) / mass
    columns = (images.sum(axis=1, dtype=float) @ np.arange(images.shape[2])) / mass
    return np.stack([rows, columns], axis=1)
