"""The residual of a state whose grains are strained: twelve unknowns a grain, motions (u, δ) first, then strains.

At given strains it is the residual of rigid grains with stretched voxels (`residual.StateProblem`).  The Jacobian has
a second row of six unknowns for each grain, so that blocks, products and solvers stay those of rigid motions.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from grainmotion._typing import Float
from grainmotion.model.pose import Pose
from grainmotion.model.strain import bounded, stretches
from grainmotion.objective.data_term import Target
from grainmotion.objective.evaluation import LinearizedEvaluation
from grainmotion.objective.nuisance_motions import corrected_geometry
from grainmotion.objective.priors import with_own_blocks
from grainmotion.objective.residual import StateProblem
from grainmotion.projection.grain_arrays import GrainArrays
from grainmotion.projection.strain_derivatives import differentiate_by_strain, joined
from grainmotion.solvers.gauss_newton import Linearization

MAX_PRINCIPAL_STRAIN, MAX_STRAIN_STEP = 0.5, 0.1
"""Largest principal strain, and largest change of a component in a step: stretches stay far from singular."""


@dataclass(frozen=True, eq=False)
class StrainedPose:
    """Motions of all grains, and their strains ``(n, 6)`` (see `model.strain`)."""

    pose: Pose
    strains: Float


@dataclass(frozen=True, eq=False)
class StrainProblem:
    """The residual of one state with strained grains, a `gauss_newton.Problem`.

    ``grains`` are rigid ones; ``strain_sd`` is the standard deviation of the prior on each strain, about zero.
    """

    grains: GrainArrays
    target: Target
    strain_sd: float

    def at(self, strains: Float) -> StateProblem:
        """The problem of the motions alone, at given strains."""
        return StateProblem(self.grains.stretched(stretches(strains)), self.target)

    @property
    def precision(self) -> float:
        """Of the prior on each strain, in units of the cost."""
        return self.target.expected_variance / self.strain_sd**2

    def cost(self, state: StrainedPose) -> float:
        """½‖r‖², with the priors' share."""
        return self.at(state.strains).cost(state.pose) + self._prior_cost(state)

    def linearize(self, state: StrainedPose) -> Linearization:
        """Cost, gradient ``(12n,)`` and normal matrix, with the priors' share."""
        problem, n = self.at(state.strains), len(self.grains)
        evaluation = with_strains(problem, state.pose)
        linear = problem.linearize_at(state.pose, evaluation)
        precisions = np.zeros((2 * n, 6, 6))
        precisions[n:] = self.precision * np.eye(6)
        gradient = linear.gradient.copy()
        gradient[6 * n :] += self.precision * state.strains.ravel()
        cost, hessian = linear.cost + self._prior_cost(state), with_own_blocks(linear.hessian, precisions)
        return replace(linear, cost=cost, gradient=gradient, hessian=hessian)

    def _prior_cost(self, state: StrainedPose) -> float:
        return 0.5 * self.precision * float((state.strains**2).sum())

    def retract(self, state: StrainedPose, step: Float) -> StrainedPose:
        """Motions as those of rigid grains; strains add up, within bounds."""
        motion_step, strain_step = self._split(step)
        pose = self.at(state.strains).retract(state.pose, motion_step)
        return StrainedPose(pose, bounded(state.strains + strain_step, MAX_PRINCIPAL_STRAIN))

    def step_sizes(self, state: StrainedPose, step: Float) -> Float:
        """Upper bound of the displacement of each grain's surface, in voxels ``(n,)``."""
        motion_step, strain_step = self._split(step)
        by_strain = np.linalg.norm(strain_step, axis=1) * self.grains.radii / self.grains.unit
        return np.asarray(self.at(state.strains).step_sizes(state.pose, motion_step) + by_strain)

    def _split(self, step: Float) -> tuple[Float, Float]:
        """A step's part of the motions, of the grains and beside them, and that of the strains, bounded ``(n, 6)``."""
        end = 6 * len(self.grains)
        strain_step = step[end : 2 * end].reshape(-1, 6)
        largest = np.maximum(np.abs(strain_step).max(axis=1), 1e-300)
        factors = np.minimum(1.0, MAX_STRAIN_STEP / largest)
        return np.concatenate([step[:end], step[2 * end :]]), strain_step * factors[:, None]


def with_strains(
    problem: StateProblem, pose: Pose, evaluation: LinearizedEvaluation | None = None
) -> LinearizedEvaluation:
    """An evaluation of a problem whose jacobian has 2n rows of six: motions, then strains.

    ``evaluation`` is that of the motions, filtered, if it is there already.
    """
    target = problem.target
    evaluation = problem.evaluate_with_derivatives(pose) if evaluation is None else evaluation
    geometry = corrected_geometry(target.scan.geometry, pose.nuisance)
    by_strain = differentiate_by_strain(problem.grains, pose, geometry, evaluation.patches, target.projector)
    by_strain.filter(target.root_weights * evaluation.response.derivative(evaluation.line_integrals), target.kernel)
    return replace(evaluation, jacobian=joined(evaluation.jacobian, by_strain))
