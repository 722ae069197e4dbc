"""The D-DPC residual of one state, and its normal equations, for the solver.

Eq. 22 of Khalili et al. (2017), weighted and filtered:  r = F w (b − m(P)), see `target`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from grainmotion import motion
from grainmotion.packed import PackedGrains, Pose, Surroundings
from grainmotion.solve import Linearization
from grainmotion.tracking import surroundings
from grainmotion.tracking.target import Seen, Target, gaussian

__all__ = ["Prior", "Seen", "StateProblem", "Target", "gaussian"]

Float = NDArray[np.float64]
Basis = Callable[[PackedGrains, Pose], Float]
"""From grains and pose to T ``(6n, m)``: the increments (u, δ) of all grains per unit of m parameters."""


@dataclass(frozen=True, eq=False)
class Prior:
    """Where the grains are expected: ``precisions (n, 6, 6)`` of (u, δ) from there, in units of the cost."""

    pose: Pose
    precisions: Float

    def departure(self, pose: Pose) -> Float:
        """(u, δ) of each grain from where it is expected, ``(n, 6)``."""
        turns = motion.log(pose.matrices @ np.swapaxes(self.pose.matrices, 1, 2))
        return np.hstack([pose.translations - self.pose.translations, turns])


@dataclass(frozen=True, eq=False)
class StateProblem:
    """The residual of one state as `solve.Problem`; ``basis`` ties the grains' motions together (None: all free)."""

    grains: PackedGrains
    target: Target
    basis: Basis | None = None
    prior: Prior | None = None

    def look(self, pose: Pose) -> Seen:
        """Simulate, compare and differentiate at a pose."""
        return self.target.crew.look(self.grains, self.target, pose)

    def linearize(self, state: Pose) -> Linearization:
        """Cost ½‖r‖², gradient and block-sparse normal matrix at a pose, with the priors' share."""
        at = self.target.crew.linearize(self.grains, self.target, state)
        cost, gradient, border = at.cost, at.gradient, at.border
        hessian, corner, slope = sparse.bsr_array(at.hessian), at.corner.copy(), at.slope
        if len(slope):
            free = len(slope)
            precisions, departure = self.surrounding_prior(state)
            slope, cost = slope + precisions @ departure, cost + 0.5 * float(departure @ precisions @ departure)
            corner[-free:, -free:] += precisions
        if self.prior is not None:
            departure = self.prior.departure(state)
            pull = np.einsum("nij,nj->ni", self.prior.precisions, departure)
            gradient, cost = gradient + pull.ravel(), cost + 0.5 * float(np.vdot(pull, departure))
            hessian = raised(hessian, self.prior.precisions)
        if self.basis is not None:
            tie = self.basis(self.grains, state)
            gradient, hessian, border = tie.T @ gradient, tie.T @ (hessian @ tie), tie.T @ border
        return Linearization(cost, gradient, hessian, border, corner, slope)

    def surrounding_prior(self, state: Pose) -> tuple[Float, Float]:
        """Precisions of the prior on the surroundings' unknowns, in units of the cost, and how far these are."""
        loose, views = self.target.loose, len(self.target.scan)
        at = state.surroundings or Surroundings.still(views)
        return self.variance * loose.precisions(views), surroundings.values(loose, at)

    @cached_property
    def variance(self) -> float:
        """What a pixel's residual is at least expected to be, squared; gives the surroundings' prior its unit."""
        return LEAST_SHARE**2 * float(np.mean(self.target.measured.astype(float) ** 2))

    def retract(self, state: Pose, step: Float) -> Pose:
        """Add translations; turn on the group, Ω ← exp[δ]ₓ Ω; move the surroundings."""
        each, rest = self._each(state, step)
        around = state.surroundings
        if len(rest):
            still = Surroundings.still(len(self.target.scan))
            around = surroundings.moved(self.target.loose, around or still, rest)
        return Pose(state.translations + each[:, :3], motion.exp(each[:, 3:]) @ state.matrices, around)

    def size(self, state: Pose, step: Float) -> float:
        """Largest displacement of any grain's surface, in voxels."""
        each, _ = self._each(state, step)
        moved = np.linalg.norm(each[:, :3], axis=1) + np.linalg.norm(each[:, 3:], axis=1) * self.grains.radii
        return float(moved.max()) / self.grains.unit

    def _each(self, state: Pose, step: Float) -> tuple[Float, Float]:
        """Increments of the grains ``(n, 6)`` and of the surroundings."""
        free = len(self.target.loose.deviations(len(self.target.scan)))
        own, rest = step[: len(step) - free], step[len(step) - free :]
        full = own if self.basis is None else self.basis(self.grains, state) @ own
        return full.reshape(-1, 6), rest


LEAST_SHARE = 0.01
"""Of the radiographs' rms: the residual that is expected at least, where nothing else says what to expect."""


def raised(hessian: sparse.bsr_array, blocks: Float) -> sparse.bsr_array:
    """H with 6×6 blocks added on its diagonal."""
    n = len(blocks)
    more = sparse.bsr_array((blocks, np.arange(n), np.arange(n + 1)), shape=hessian.shape)
    return sparse.bsr_array(hessian + more, blocksize=(6, 6))
