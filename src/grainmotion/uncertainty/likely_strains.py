"""Which strain would explain what rigid motions leave over: one linear step."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from grainmotion._typing import Float
from grainmotion.model.pose import Pose
from grainmotion.model.strain import tensors
from grainmotion.objective.residual import StateProblem
from grainmotion.objective.strain_problem import with_strains
from grainmotion.solvers.gauss_newton import damped_step
from grainmotion.solvers.semidefinite import pseudo_inverse

TEST_FORCING = 0.1
"""Relative residual to which the step of many grains is solved: a test needs one digit."""


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
