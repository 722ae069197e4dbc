"""The D-DPC residual of one state as a least-squares problem for the solver: cost, normal equations and steps."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from grainmotion._typing import Float
from grainmotion.model.pose import NuisanceMotion, Pose
from grainmotion.objective import nuisance_motions
from grainmotion.objective.data_term import Target
from grainmotion.objective.evaluation import Evaluation, LinearizedEvaluation, evaluate, evaluate_with_derivatives
from grainmotion.objective.global_parameters import Columns
from grainmotion.objective.normal_matrix import normal_of
from grainmotion.objective.priors import MotionPrior, nuisance_prior
from grainmotion.projection.grain_arrays import GrainArrays
from grainmotion.rotations import rotation_matrix
from grainmotion.solvers.gauss_newton import Linearization

Basis = Callable[[GrainArrays, Pose], Float]
"""From grains and pose to T ``(6n, m)``: the increments (u, δ) of all grains per unit of m parameters."""


@dataclass(frozen=True, eq=False)
class StateProblem:
    """The residual of one state, a `gauss_newton.Problem`.

    ``basis`` ties the grains' motions to a few parameters (None: every grain is free); ``prior`` says where grains
    are expected.
    """

    grains: GrainArrays
    target: Target
    basis: Basis | None = None
    prior: MotionPrior | None = None

    def evaluate(self, pose: Pose) -> Evaluation:
        """Simulate and compare at a pose."""
        return evaluate(self.grains, self.target, pose)

    def evaluate_with_derivatives(self, pose: Pose) -> LinearizedEvaluation:
        """Simulate, compare and differentiate at a pose."""
        return evaluate_with_derivatives(self.grains, self.target, pose)

    def cost(self, state: Pose) -> float:
        """½‖r‖² at a pose, with the priors' share."""
        return self.evaluate(state).cost + self._prior_cost(state)

    def linearize(self, state: Pose) -> Linearization:
        """Cost ½‖r‖², gradient and normal matrix at a pose, with the priors' share."""
        evaluation = evaluate_with_derivatives(self.grains, self.target, state, filtered=self.basis is None)
        if self.basis is not None:
            return self._linearize_tied(state, self.basis(self.grains, state), evaluation)
        return self.linearize_at(state, evaluation)

    def linearize_at(self, state: Pose, evaluation: LinearizedEvaluation) -> Linearization:
        """The same for free grains, from an evaluation whose Jacobian may have more unknowns than the motions."""
        jacobian, residual = evaluation.jacobian, evaluation.residual
        columns = evaluation.response_columns + evaluation.nuisance_columns
        hessian = normal_of(jacobian)
        products = (Columns([residual], [True]) + columns).border(jacobian)
        gradient, border, corner = -products[:, 0], np.ascontiguousarray(products[:, 1:]), columns.gram()
        nuisance_gradient = self._with_nuisance_prior(state, corner, -evaluation.nuisance_columns.dot(residual))
        if self.prior is not None:
            gradient = gradient + self.prior.gradient(state).ravel()
            hessian = self.prior.add_to(hessian)
        cost = evaluation.cost + self._prior_cost(state)
        return Linearization(cost, gradient, hessian, border, corner, nuisance_gradient)

    def _linearize_tied(self, state: Pose, basis: Float, evaluation: LinearizedEvaluation) -> Linearization:
        """The same for the m parameters of a basis T ``(6n, m)``.

        Each parameter makes one image, so that m images are filtered instead of six patches a grain and view.
        """
        target, n, m = self.target, len(self.grains), basis.shape[1]
        response_derivative = evaluation.response.derivative(evaluation.line_integrals)
        columns = Columns()
        for image in evaluation.jacobian.images(basis.T.reshape(m, n, 6)):
            columns.add(target.filtered(response_derivative * image), shared=True)
        gram = (columns + evaluation.response_columns + evaluation.nuisance_columns).gram()
        hessian, border, corner = gram[:m, :m], gram[:m, m:], gram[m:, m:]
        gradient = -columns.dot(evaluation.residual)
        nuisance_gradient = -evaluation.nuisance_columns.dot(evaluation.residual)
        nuisance_gradient = self._with_nuisance_prior(state, corner, nuisance_gradient)
        if self.prior is not None:
            gradient = gradient + basis.T @ self.prior.gradient(state).ravel()
            precisions = np.einsum("nij,njm->nim", self.prior.precisions, basis.reshape(n, 6, m))
            hessian = hessian + basis.T @ precisions.reshape(6 * n, m)
        cost = evaluation.cost + self._prior_cost(state)
        return Linearization(cost, gradient, hessian, border, corner, nuisance_gradient)

    def _with_nuisance_prior(self, state: Pose, corner: Float, gradient: Float) -> Float:
        """Add the prior on the nuisance motions: to the corner's last rows, in place, and to the gradient returned."""
        free = len(gradient)
        if not free:
            return gradient
        precisions, departure = nuisance_prior(self.target, state)
        corner[-free:, -free:] += precisions
        return gradient + precisions @ departure

    def _prior_cost(self, state: Pose) -> float:
        """The priors' share of the cost."""
        cost = 0.0
        if self.target.nuisance.moving_bodies or self.target.nuisance.views:
            precisions, departure = nuisance_prior(self.target, state)
            cost += 0.5 * float(departure @ precisions @ departure)
        return cost if self.prior is None else cost + self.prior.cost(state)

    def retract(self, state: Pose, step: Float) -> Pose:
        """Add translations; rotate on the group, Ω ← exp[δ]ₓ Ω; move the bodies and the views."""
        increments, nuisance_step = self._increments(state, step)
        motion = state.nuisance
        if len(nuisance_step):
            start = motion or NuisanceMotion.still(len(self.target.scan), len(self.target.nuisance.freedoms))
            motion = nuisance_motions.retract(self.target.nuisance, start, nuisance_step)
        matrices = rotation_matrix(increments[:, 3:]) @ state.matrices
        return Pose(state.translations + increments[:, :3], matrices, motion)

    def step_sizes(self, state: Pose, step: Float) -> Float:
        """Largest displacement of each grain's surface, in voxels ``(n,)``."""
        return np.asarray(self._surface_displacements(self._increments(state, step)[0]) / self.grains.unit)

    def _surface_displacements(self, increments: Float) -> Float:
        """Upper bound ``(n,)`` of the displacement of each grain's surface by increments ``(n, 6)``, mm."""
        rotations = np.linalg.norm(increments[:, 3:], axis=1) * self.grains.radii
        return np.asarray(np.linalg.norm(increments[:, :3], axis=1) + rotations)

    def _increments(self, state: Pose, step: Float) -> tuple[Float, Float]:
        """Increments (u, δ) of the grains ``(n, 6)`` and of the nuisance motions, from a solver's step.

        A free grain moves by its own diameter at most: steps are huge in directions that the views hardly determine.
        """
        free = len(self.target.nuisance.deviations(len(self.target.scan)))
        parameters, nuisance_step = step[: len(step) - free], step[len(step) - free :]
        if self.basis is not None:
            return (self.basis(self.grains, state) @ parameters).reshape(-1, 6), nuisance_step
        increments = parameters.reshape(-1, 6)
        distances = np.maximum(self._surface_displacements(increments), 1e-300)
        return increments * np.minimum(1.0, 2 * self.grains.radii / distances)[:, None], nuisance_step
