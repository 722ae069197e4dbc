"""The grains that have a place in a state, and the reasons of those that have none."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from grainmotion._typing import Float
from grainmotion.errors import InputError
from grainmotion.mechanics.surfaces import is_slice
from grainmotion.model.grains import GrainSet
from grainmotion.model.motions import Motions
from grainmotion.rotations import apply_motion, recenter, skew_matrix

NO_SURFACE = "a slice of one voxel layer: its grains have no surfaces"


@dataclass(frozen=True, eq=False)
class PlacedGrains:
    """Grains at their places in a state: rows of the set, and x = F (X − c) + u + c of each."""

    rows: NDArray[np.int64]
    gradients: Float
    translations: Float
    centers: Float
    covariances: Float  # (n, 6, 6) of u and the increment of the rotation, zero in the reference

    def to_state(self, k: int, points: Float) -> Float:
        return apply_motion(self.gradients[k], self.translations[k], self.centers[k], points)

    def to_reference(self, k: int, points: Float) -> Float:
        relative = points - self.translations[k] - self.centers[k]
        return relative @ np.linalg.inv(self.gradients[k]).T + self.centers[k]

    def lever(self, k: int, point: Float, normal: Float) -> Float:
        """Derivative of n·x by the motion of grain k, for its material point that is at ``point``."""
        arm = point - self.centers[k] - self.translations[k]
        return np.concatenate([normal, -skew_matrix(arm).T @ normal])


def placed_grains(grains: GrainSet, motions: Motions | None) -> tuple[PlacedGrains, tuple[tuple[int, str], ...]]:
    """The grains that have a place in the state, and the others with the reason."""
    n = len(grains)
    if is_slice(grains):
        motions, flat = Motions.identity(np.zeros(0, dtype=np.int64), np.zeros((0, 3))), NO_SURFACE
    else:
        flat = ""
    if motions is None:
        identity, zero = np.broadcast_to(np.eye(3), (n, 3, 3)), np.zeros((n, 3))
        return PlacedGrains(np.arange(n), identity, zero, grains.centers, np.zeros((n, 6, 6))), ()
    row_of = {int(label): row for row, label in enumerate(grains.labels)}
    unknown = sorted({int(label) for label in motions.labels} - set(row_of))
    if unknown:
        fact = f"labels {unknown[:10]} are not among the grains"
        raise InputError("motions.label", fact, "use motions of this reference")
    finite = np.isfinite(np.hstack([motions.translations, motions.rotations])).all(axis=1)
    kept = np.flatnonzero(motions.ok_translation & finite)
    rows = np.array([row_of[int(label)] for label in motions.labels[kept]], dtype=np.int64)
    told = dict(zip(motions.labels.tolist(), motions.statuses.tolist(), strict=True))
    used = set(rows.tolist())
    left_out = tuple(
        (int(label), flat or f"translation not to use: {told.get(int(label), 'not among the motions')}")
        for row, label in enumerate(grains.labels)
        if row not in used
    )
    gradients, centers = motions.gradients[kept], grains.centers[rows]
    shifts = recenter(gradients, motions.translations[kept], motions.centers[kept], centers)
    return PlacedGrains(rows, gradients, shifts, centers, motions.covariances[kept]), left_out
