"""Priors on the motions of grains and on the nuisance motions, in units of the cost."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from grainmotion._typing import Float
from grainmotion.model.pose import NuisanceMotion, Pose
from grainmotion.objective.data_term import Target
from grainmotion.objective.normal_matrix import PatchNormalMatrix
from grainmotion.objective.nuisance_motions import nuisance_values
from grainmotion.rotations import rotation_vector
from grainmotion.solvers.block_cg import Hessian


@dataclass(frozen=True, eq=False)
class MotionPrior:
    """Where the grains are expected: ``precisions (n, 6, 6)`` of (u, δ) from ``pose``."""

    pose: Pose
    precisions: Float

    def replaced(self, other: MotionPrior, which: NDArray[np.bool_]) -> MotionPrior:
        """This prior with that of the grains ``which (n,)`` taken from another one about the same pose."""
        return MotionPrior(self.pose, np.where(which[:, None, None], other.precisions, self.precisions))

    def departure(self, pose: Pose) -> Float:
        """(u, δ) of each grain from where it is expected, ``(n, 6)``."""
        rotations = rotation_vector(pose.matrices @ np.swapaxes(self.pose.matrices, 1, 2))
        return np.hstack([pose.translations - self.pose.translations, rotations])

    def gradient(self, pose: Pose) -> Float:
        """Gradient of the prior's share of the cost, ``(n, 6)``."""
        return np.asarray(np.einsum("nij,nj->ni", self.precisions, self.departure(pose)))

    def cost(self, pose: Pose) -> float:
        """The prior's share of the cost."""
        return 0.5 * float(np.vdot(self.gradient(pose), self.departure(pose)))

    def add_to(self, hessian: sparse.bsr_array | PatchNormalMatrix) -> sparse.bsr_array | PatchNormalMatrix:
        """JᵀJ with the precisions added to the 6×6 blocks on its diagonal."""
        return with_own_blocks(hessian, self.precisions)


def with_own_blocks(hessian: Hessian, blocks: Float) -> sparse.bsr_array | PatchNormalMatrix:
    """JᵀJ of free grains with 6×6 ``blocks (n, 6, 6)`` added on its diagonal."""
    if isinstance(hessian, PatchNormalMatrix):
        return hessian.lifted(blocks)
    assert isinstance(hessian, sparse.bsr_array)
    n = len(blocks)
    diagonal = sparse.bsr_array((blocks, np.arange(n), np.arange(n + 1)), shape=hessian.shape)
    return sparse.bsr_array(hessian + diagonal, blocksize=(6, 6))


def nuisance_prior(target: Target, pose: Pose) -> tuple[Float, Float]:
    """Precisions ``(k, k)`` of the prior on the nuisance unknowns, and their values ``(k,)`` at a pose."""
    nuisance, views = target.nuisance, len(target.scan)
    motion = pose.nuisance or NuisanceMotion.still(views, len(nuisance.freedoms))
    return target.expected_variance * nuisance.precisions(views), nuisance_values(nuisance, motion)
