"""Which strain would explain what rigid motions leave over: one linear step, with its standard deviations."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from grainmotion._typing import Float
from grainmotion.model.pose import Pose
from grainmotion.model.strain import tensors
from grainmotion.objective.evaluation import LinearizedEvaluation
from grainmotion.objective.residual import StateProblem
from grainmotion.objective.strain_problem import with_strains
from grainmotion.projection.jacobian import PatchJacobian
from grainmotion.solvers.gauss_newton import damped_step
from grainmotion.solvers.semidefinite import pseudo_inverse
from grainmotion.uncertainty.covariance import pixel_variances, propagating

TEST_FORCING = 0.1
"""Relative residual to which the step of many grains is solved: a test needs one digit."""


@dataclass(frozen=True, eq=False)
class LikelyStrains:
    """Strains ``(n, 6)`` that one step gives each grain beside all motions, and their covariances ``(n, 6, 6)``."""

    strains: Float
    covariances: Float

    @property
    def chi2(self) -> Float:
        """eᵀ C⁻¹ e ``(n,)``: about 6 where no grain is strained and the pixels' variances are right."""
        return np.asarray(np.einsum("ni,nij,nj->n", self.strains, pseudo_inverse(self.covariances), self.strains))


def likely_strains(problem: StateProblem, pose: Pose, evaluation: LinearizedEvaluation | None = None) -> LikelyStrains:
    """The strains that a solution of rigid motions makes likely, by one step of all grains together.

    ``evaluation`` is that of ``problem`` at the pose, with filtered derivatives, if it is there already.  Covariances
    hold the other grains in their places; they come from the variances of the pixels (`covariance.pixel_variances`).
    """
    joint = with_strains(problem, pose, evaluation)
    n = len(problem.grains)
    at = replace(problem, prior=None).linearize_at(pose, joint)
    step = damped_step(at, 0.0, TEST_FORCING)[6 * n : 12 * n]
    inverse = pseudo_inverse(_own_information(joint.jacobian))
    noise = _own_information(propagating(joint.jacobian, problem.target, pixel_variances(problem.target, joint)))
    return LikelyStrains(step.reshape(n, 6), (inverse @ noise @ inverse)[:, 6:, 6:])


@dataclass(frozen=True, eq=False)
class StrainStep:
    """What one step of all motions and strains together would do.

    ``motions (n, 6)`` are changes of (u, δ), mm and radians, ``strains (n, 6)`` those of the strains, and ``explained
    (n,)`` is the share of the squared residual in each grain's shadow that is gone then.
    """

    motions: Float
    strains: Float
    explained: Float

    @property
    def principal(self) -> Float:
        """The largest principal strain of each grain, in size, ``(n,)``."""
        return np.asarray(np.abs(np.linalg.eigvalsh(tensors(self.strains))).max(axis=1))


def strain_step(problem: StateProblem, pose: Pose) -> StrainStep:
    """One step from a solution of rigid motions, and how much of the residual it would explain."""
    joint, n = with_strains(problem, pose), len(problem.grains)
    at = replace(problem, prior=None).linearize_at(pose, joint)
    step = damped_step(at, 0.0, TEST_FORCING)[: 12 * n].reshape(1, 2 * n, 6)
    left = joint.residual - joint.jacobian.images(step)[0]
    columns = joint.response_columns + joint.nuisance_columns
    if columns.stacks:
        left = left - columns.combine(pseudo_inverse(columns.gram()) @ columns.dot(left))
    squares = np.zeros((n, 2))
    for grain, own, (good, before, after) in joint.grain_pixels(problem.target.valid, joint.residual, left):
        weight = np.abs(own) * good
        squares[grain] += [weight @ image.astype(float) ** 2 for image in (before, after)]
    explained = 1 - squares[:, 1] / np.maximum(squares[:, 0], 1e-300)
    return StrainStep(step[0, :n], step[0, n:], np.where(squares[:, 0] > 0, explained, 0.0))


def _own_information(jacobian: PatchJacobian) -> Float:
    """JᵀJ of each grain's motion and strain together, ``(n, 12, 12)``, from a Jacobian of 2n rows of six."""
    count, boxes = len(jacobian.patches.boxes) // 2, jacobian.patches.boxes
    first = np.searchsorted(boxes[:count, 0], np.arange(len(jacobian) // 2 + 1))
    own = np.arange(count)
    blocks = [
        jacobian.gram_blocks(np.ascontiguousarray(np.column_stack([own + a * count, own + b * count])), first)
        for a, b in ((0, 0), (0, 1), (1, 1))
    ]
    return np.block([[blocks[0], blocks[1]], [np.swapaxes(blocks[1], 1, 2), blocks[2]]])
