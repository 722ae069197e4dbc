"""Weak directions: those in which the views hardly determine a grain, and the prior that fixes it there.

The prior is one more observation, that the grain moved as the smooth field (or the start) says, with a standard
deviation of `PRIOR_SHIFT_DIAMETERS` diameters and `PRIOR_ROTATION` radians.  It acts in the weak directions alone, so
that directions which the views determine well are left as they are.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from grainmotion._typing import Float
from grainmotion.model.pose import Pose
from grainmotion.objective.priors import MotionPrior
from grainmotion.projection.grain_arrays import GrainArrays
from grainmotion.solvers.block_cg import NormalMatrix, diagonal_blocks

PRIOR_SHIFT_DIAMETERS, PRIOR_ROTATION = 0.1, 0.5
"""Standard deviations of the prior: of translations, in grain diameters, and of rotations, radians."""
WEAK_SD_SHARE = 0.5
"""A direction is weak where its standard deviation exceeds this share of the prior's."""
MAX_SCALED_VARIANCE = 1e6
"""Variance, in units of the prior's, that counts as no information at all."""
AXIS_COSINE = 0.98
"""Cosine from which a direction is called by the name of an axis."""


@dataclass(frozen=True, eq=False)
class WeakDirections:
    """Weak directions of every grain.

    ``scales (n, 6)`` are the prior's standard deviations of (u, δ), mm and radians; ``vectors (n, 6, 6)`` hold in
    their columns the principal directions of each covariance in these units, ``variances (n, 6)`` go with them.
    """

    scales: Float
    vectors: Float
    variances: Float

    @property
    def flags(self) -> NDArray[np.bool_]:
        """Which of the directions are weak, ``(n, 6)``."""
        return self.variances > WEAK_SD_SHARE**2

    def prior(self, hessian: sparse.bsr_array | NormalMatrix, pose: Pose) -> MotionPrior:
        """The prior that fixes the weak directions at ``pose``.

        Its precision along a direction is the information in ``hessian`` times the variance that the data really
        leave, so that data and prior are weighted by their true variances.
        """
        directions = self._directions()
        formal = np.einsum("nij,nik->njk", directions, diagonal_blocks(hessian) @ directions)
        strength = np.where(self.flags, np.diagonal(formal, axis1=1, axis2=2) * self.variances, 0.0)
        rows = self.vectors / self.scales[:, :, None]
        return MotionPrior(pose, np.einsum("nij,nj,nkj->nik", rows, strength, rows))

    def posterior(self) -> Float:
        """Covariances ``(n, 6, 6)`` with the prior."""
        variances = np.where(self.flags, self.variances / (1 + self.variances), self.variances)
        directions = self._directions()
        return np.einsum("nij,nj,nkj->nik", directions, variances, directions)

    def _directions(self) -> Float:
        """The principal directions in their columns, mm and radians."""
        return self.vectors * self.scales[:, :, None]


def weak_directions(covariances: Float, grains: GrainArrays) -> WeakDirections:
    """Principal directions of covariances ``(n, 6, 6)``, in the prior's standard deviations."""
    scales = np.stack([np.repeat([PRIOR_SHIFT_DIAMETERS * 2 * radius, PRIOR_ROTATION], 3) for radius in grains.radii])
    scaled = np.nan_to_num(covariances) / (scales[:, :, None] * scales[:, None, :])
    shrink = np.sqrt(np.minimum(1.0, MAX_SCALED_VARIANCE / np.maximum(np.diagonal(scaled, axis1=1, axis2=2), 1e-300)))
    values, vectors = np.linalg.eigh(scaled * shrink[:, :, None] * shrink[:, None, :])
    return WeakDirections(scales, vectors, np.maximum(values, 0.0))


def poorly_determined(covariance: Float, limits: tuple[float, float]) -> list[str]:
    """Names of a grain's directions whose standard deviation exceeds the limits (mm, radians)."""
    names = []
    for part, limit, motion in (
        (slice(0, 3), limits[0], "translation along"),
        (slice(3, 6), limits[1], "rotation about"),
    ):
        values, vectors = np.linalg.eigh(covariance[part, part])
        bad = vectors[:, ~(values <= limit**2)].T
        names += [f"{motion} any axis"] if len(bad) == 3 else [f"{motion} {_axis_name(v)}" for v in bad]
    return names


def _axis_name(vector: Float) -> str:
    k = int(np.argmax(np.abs(vector)))
    if abs(vector[k]) > AXIS_COSINE:
        return "xyz"[k]
    x, y, z = vector * np.sign(vector[k])
    return f"({x:.2f}, {y:.2f}, {z:.2f})"
