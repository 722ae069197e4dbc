"""Beam hardening that a state shows by itself: one more unknown of the response, where it explains enough.

The reference's voxels are what a polychromatic beam makes of the grains on average over its views.  In a later state
grains lie behind others, so that their images are too strong or too faint by what the square of the line integral
describes.  Grains turn and move to explain that, unless the response does.
"""

from __future__ import annotations

from dataclasses import replace

from grainmotion.model.pose import Pose
from grainmotion.objective.global_parameters import dot
from grainmotion.objective.residual import StateProblem
from grainmotion.solvers.gauss_newton import Solution, gauss_newton
from grainmotion.solvers.semidefinite import pseudo_inverse
from grainmotion.tracking.multistage import MultistageFit

MIN_EXPLAINED_BY_SQUARE = 0.04
"""Share of the squared residual that the square of the line integral explains, from which it becomes an unknown: 0.0001
to 0.0004 in clean experiments, 0.02 with a reference of 15 views, 0.04 to 0.08 with four energies and a wall, 0.4
with hardening of 20 %."""


def with_hardening(
    fit: MultistageFit, problem: StateProblem, solution: Solution[Pose]
) -> tuple[StateProblem, Solution[Pose]]:
    """The problem and its solution with a response of degree 2, if the settings leave that to the state."""
    settings = fit.settings
    if settings.hardening == "auto":
        if settings.gain == "none" or explained_by_square(problem, solution.state) < MIN_EXPLAINED_BY_SQUARE:
            return problem, solution
        settings = fit.settings = replace(settings, hardening=2)  # also for stages that follow
    degree = settings.response_model.degree
    if problem.target.response_model.degree == degree:
        return problem, solution
    model = replace(problem.target.response_model, degree=degree)
    problem = replace(problem, target=replace(problem.target, response_model=model))
    observe = fit.observer(problem.target, "beam hardening")
    return problem, gauss_newton(problem, solution.state, fit.fine_stopping(), observe)


def explained_by_square(problem: StateProblem, pose: Pose) -> float:
    """Share of ‖r‖² at a pose that the square of the line integral explains beside the unknowns of the response."""
    evaluation = problem.evaluate(pose)
    residual, columns = evaluation.residual, evaluation.response_columns
    square = problem.target.filtered(evaluation.line_integrals**2)
    own = columns.dot(square)
    left = dot(square, square) - float(own @ pseudo_inverse(columns.gram()) @ own)
    cost = dot(residual, residual)
    if left <= 1e-6 * dot(square, square) or cost <= 0:
        return 0.0
    return float(dot(square, residual) ** 2 / left / cost)
