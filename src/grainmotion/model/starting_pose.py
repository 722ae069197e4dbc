"""The pose in which grains are at first, from the motions of another state."""

from __future__ import annotations

import numpy as np

from grainmotion.errors import InputError
from grainmotion.model.grains import GrainSet
from grainmotion.model.motions import Motions
from grainmotion.model.pose import Pose
from grainmotion.rotations import recenter, rotation_matrix


def starting_pose(grains: GrainSet, start: Motions | None) -> Pose:
    """The pose of ``grains`` in ``start``, matched by label; grains without a motion follow the mean of the others."""
    n = len(grains)
    pose = Pose(np.zeros((n, 3)), np.broadcast_to(np.eye(3), (n, 3, 3)).copy())
    if start is None:
        return pose
    rows = {int(label): k for k, label in enumerate(start.labels)}
    missing = [int(label) for label in grains.labels if int(label) not in rows]
    if missing:
        raise InputError("initial", f"grains {missing[:5]} have no row", "give the motions of the same reference")
    order = [rows[int(label)] for label in grains.labels]
    translations, rotations = start.translations[order], start.rotations[order]
    known = np.all(np.isfinite(np.hstack([translations, rotations])), axis=1)
    if not known.any():
        return pose
    # The start may come from another segmentation, whose centres differ a little.
    matrices = rotation_matrix(np.where(known[:, None], rotations, 0.0))
    shifted = recenter(matrices, np.nan_to_num(translations), start.centers[order], grains.centers)
    return Pose(np.where(known[:, None], shifted, shifted[known].mean(axis=0)), matrices)
