"""Whether the background moved: it is fixed where it was in the reference unless the radiographs contradict that.

A background of noise and streaks has many minima.  Free to move, it goes into one of them, and the grains move with
it by a fraction of their standard deviations; which minimum that is depends on the last digits of the arithmetic.  So
once all grains are near, the same problem is solved with a fixed background, and the rise of the cost is compared
with the one that noise alone gives to six unknowns.
"""

from __future__ import annotations

from dataclasses import replace

from grainmotion.model.pose import Pose
from grainmotion.objective.data_term import Target
from grainmotion.objective.residual import StateProblem
from grainmotion.solvers.gauss_newton import Solution
from grainmotion.tracking.multistage import MultistageFit
from grainmotion.uncertainty.noise_model import shaded_pixels

MOVED_BACKGROUND_CHI2 = 2.5
"""χ² over its degrees of freedom from which the background moved: measured 0.5 to 0.8 where it did not, 400 for a
dense tube that moved by 0.06 voxel, and as the square of the motion."""
BACKGROUND_UNKNOWNS = 6
FIXED_BACKGROUND_SD = 1e-6
"""Standard deviations that fix the background, over the prior's."""
FIXED_BACKGROUND_NOTE = "the background was fixed where it was in the reference: the radiographs do not show a motion"


def fixed_unless_moved(
    fit: MultistageFit, problem: StateProblem, solution: Solution[Pose]
) -> tuple[StateProblem, Solution[Pose], bool]:
    """The problem and its solution, with a fixed background unless it moved, and whether it is fixed."""
    target, nuisance, pose = fit.target, fit.target.nuisance, solution.state
    if not nuisance.background:
        return problem, solution, False
    fixed = replace(
        nuisance,
        background_shift_sd=FIXED_BACKGROUND_SD * nuisance.background_shift_sd,
        background_rotation_sd=FIXED_BACKGROUND_SD * nuisance.background_rotation_sd,
    )
    fit.target = replace(target, nuisance=fixed)
    start = Pose(pose.translations, pose.matrices)
    fixed_problem, end = fit.solve_free(start, "background held", fit.settings.filters[-1:])
    rise = end.costs[-1] - solution.costs[-1]
    pixels = int(shaded_pixels(problem.target, problem.evaluate(pose)).sum())
    variance = 2 * solution.costs[-1] / max(pixels, 1)
    if 2 * rise <= MOVED_BACKGROUND_CHI2 * BACKGROUND_UNKNOWNS * variance * correlated_pixels(problem.target):
        return fixed_problem, end, True
    fit.target = target
    return problem, solution, False


def correlated_pixels(target: Target) -> float:
    """Effective number of pixels over which the filter correlates noise."""
    kernel = target.kernel.astype(float)
    return float(1.0 / (2 * (kernel**2).sum() - kernel[0] ** 2) ** 2)
