"""Rotations of many grains kept near expected ones while all grains are only being brought near.

Under a wide filter hardly any view shows how a smooth grain is rotated.  Its rotation then follows what its neighbours'
misplacement leaves over, by tens of degrees, and the stages after it spend their steps on the way back.  One more
observation of each grain, that it rotated as the smooth field (or the start) says within `PRIOR_ROTATION`, ends this
(decision 0061).  It is weighed against residuals as large as stages on the way have; a rotation that the radiographs
show well hardly feels it, and the last stages do without it.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from grainmotion.model.pose import Pose
from grainmotion.objective.priors import MotionPrior
from grainmotion.objective.residual import StateProblem
from grainmotion.uncertainty.weak_directions import PRIOR_ROTATION

RESIDUAL_WHILE_FAR, RESIDUAL_WHILE_NEAR = 0.1, 0.03
"""Residuals to expect in stages that a narrower filter follows, and in the first one with the narrowest filter, as
shares of the radiographs' rms."""


def near_expected_rotations(problem: StateProblem, expected: Pose, residual: float) -> StateProblem:
    """The same problem with rotations expected near those of a pose, for a relative ``residual`` to expect.

    Under a Gaussian filter of σ pixels residuals are alike over some σ² pixels, which count as one.
    """
    alike = max(1.0, problem.target.sigma**2)
    variance = residual**2 * alike * float(np.mean(problem.target.measured.astype(float) ** 2))
    precisions = np.zeros((len(problem.grains), 6, 6))
    precisions[:, range(3, 6), range(3, 6)] = variance / PRIOR_ROTATION**2
    return replace(problem, prior=MotionPrior(expected, precisions))
