"""Beam hardening that a state shows by itself: one more unknown of the response, where it explains enough.

The reference's voxels are what a polychromatic beam makes of the grains on average over its views.  In a later state
grains lie behind others, so that their images are too strong or too faint by what the square of the line integral
describes.  Grains turn and move to explain that, unless the response does.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from grainmotion.model.pose import Pose
from grainmotion.objective.global_parameters import dot
from grainmotion.objective.residual import StateProblem
from grainmotion.solvers.gauss_newton import Solution, gauss_newton
from grainmotion.solvers.semidefinite import pseudo_inverse
from grainmotion.tracking.multistage import MultistageFit

MIN_EXPLAINED_BY_SQUARE, MIN_BEND, MIN_BEND_SD = 0.02, 0.01, 4.0
"""Share of the squared residual that the square of the line integral explains, relative loss of the longest path, and
the same over its standard deviation between the views, from which the square becomes an unknown.  Clean experiments
have at most 0.003, 0.007 (with either sign) and 3; four energies beside a wall 0.03 to 0.06, 0.015 to 0.023 and 5 to 9,
a hardening of 20 % 0.24 to 0.41, 0.05 to 0.09 and 13 to 74.  A reference of 15 views imitates a share of 0.04 and a
loss of 0.13, but each view another one: 0.6 standard deviations."""
LIT_SHARE_OF_PATHS, LONGEST_PATHS = 0.05, 99.5
"""Share of the largest line integral from which a pixel shows the sample; percentile for the longest path."""


@dataclass(frozen=True)
class Bend:
    """What the square of the line integral explains of a residual.

    Attributes
    ----------
    explained : float
        Share of ‖r‖².
    loss, sd : float
        How much the longest path loses by it, relative; and its standard deviation by leaving out one view in turn,
        infinite for a single one.
    """

    explained: float
    loss: float
    sd: float

    @property
    def is_hardening(self) -> bool:
        """Whether it is more than voxels and noise imitate; a beam only ever gets harder."""
        return self.explained >= MIN_EXPLAINED_BY_SQUARE and self.loss >= max(MIN_BEND, MIN_BEND_SD * self.sd)


def with_hardening(
    fit: MultistageFit, problem: StateProblem, solution: Solution[Pose]
) -> tuple[StateProblem, Solution[Pose]]:
    """The problem and its solution with a response of degree 2, if the settings leave that to the state."""
    settings = fit.settings
    if settings.hardening == "auto":
        if settings.gain == "none" or not bend_of(problem, solution.state).is_hardening:
            return problem, solution
        settings = fit.settings = replace(settings, hardening=2)  # also for stages that follow
    degree = settings.response_model.degree
    if problem.target.response_model.degree == degree:
        return problem, solution
    model = replace(problem.target.response_model, degree=degree)
    problem = replace(problem, target=replace(problem.target, response_model=model))
    observe = fit.observer(problem.target, "beam hardening")
    return problem, gauss_newton(problem, solution.state, fit.fine_stopping(), observe)


def bend_of(problem: StateProblem, pose: Pose) -> Bend:
    """What the square of the line integral explains at a pose, beside the unknowns of the response."""
    evaluation = problem.evaluate(pose)
    residual, columns, paths = evaluation.residual, evaluation.response_columns, evaluation.line_integrals
    square = problem.target.filtered(paths**2)
    own = columns.dot(square)
    left = square - columns.combine(pseudo_inverse(columns.gram()) @ own)
    products, squares = (np.einsum("vij,vij->v", left, other, dtype=float) for other in (residual, left))
    cost = dot(residual, residual)
    if squares.sum() <= 1e-6 * dot(square, square) or cost <= 0:
        return Bend(0.0, 0.0, np.inf)
    views = len(squares)
    longest = float(np.percentile(paths[paths > LIT_SHARE_OF_PATHS * paths.max()], LONGEST_PATHS))
    spread = np.inf
    if views > 1:
        without = (products.sum() - products) / np.maximum(squares.sum() - squares, 1e-300)
        spread = float(np.sqrt((views - 1) * np.var(without)))
    explained = float(products.sum() ** 2 / squares.sum() / cost)
    return Bend(explained, -longest * float(products.sum() / squares.sum()), longest * spread)
