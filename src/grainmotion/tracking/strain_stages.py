"""The last stages with strained grains: six more unknowns each, once rigid motions have brought all near.

The strains found travel with the grains (`GrainArrays.stretches`), so that everything after these stages treats a
strained grain as a rigid one of another shape.  Such grains are projected by the CPU.
"""

from __future__ import annotations

import numpy as np

from grainmotion._typing import Float
from grainmotion.model.grains import GrainSet
from grainmotion.model.motions import Motions
from grainmotion.model.pose import Pose
from grainmotion.model.strain import components, stretches, tensors
from grainmotion.objective.data_term import Target
from grainmotion.objective.evaluation import LinearizedEvaluation
from grainmotion.objective.normal_matrix import normal_of
from grainmotion.objective.residual import StateProblem
from grainmotion.objective.strain_problem import StrainedPose, StrainProblem, with_strains
from grainmotion.projection.grain_arrays import GrainArrays, planar
from grainmotion.projection.strain_derivatives import OUT_OF_PLANE_STRAINS
from grainmotion.rotations import skew_matrix
from grainmotion.solvers.gauss_newton import Solution, gauss_newton
from grainmotion.solvers.stopping import Stopping
from grainmotion.tracking.multistage import MultistageFit
from grainmotion.uncertainty.covariance import covariances


def strains_of(grains: GrainArrays) -> Float:
    """The strains ``(n, 6)`` that grains carry; zero for rigid ones."""
    if grains.stretches is None:
        return np.zeros((len(grains), 6))
    return components(grains.stretches - np.eye(3))


def start_strained(fit: MultistageFit, grains: GrainSet, start: Motions | None) -> None:
    """Begin with the strains of the state before, where it has some."""
    if start is None or start.strains is None:
        return
    known = {int(label): row for label, row in zip(start.labels, start.strains, strict=True)}
    rows = [known.get(int(label), np.zeros(6)) for label in grains.labels]
    _stretch(fit, np.nan_to_num(np.array(rows)))


def solve_strained(
    fit: MultistageFit, problem: StateProblem, solution: Solution[Pose]
) -> tuple[StateProblem, Solution[Pose]]:
    """Motions and strains together, from a solution of the motions: under the filter before the last, then the last."""
    pose, model = solution.state, fit.settings.response_model
    for width in fit.settings.filters[-2:-1]:
        grains, target = fit.level(width, model.without_hardening)
        end = _solve(fit, grains, target, StrainedPose(pose, strains_of(grains)), fit.coarse_stopping())
        pose = end.state.pose
        _stretch(fit, end.state.strains)
    return refine_strains(fit, StateProblem(fit.fine_grains, problem.target), Solution(pose, (), np.zeros(0)))


def refine_strains(
    fit: MultistageFit, problem: StateProblem, solution: Solution[Pose]
) -> tuple[StateProblem, Solution[Pose]]:
    """Motions and strains together, from those of a problem whose grains are near."""
    n, start = len(problem.grains), StrainedPose(solution.state, strains_of(problem.grains))
    end = _solve(fit, problem.grains, problem.target, start, fit.fine_stopping())
    _stretch(fit, end.state.strains)
    step = np.concatenate([end.last_step[: 6 * n], end.last_step[12 * n :]])
    strained = StateProblem(fit.fine_grains, problem.target)
    return strained, Solution(end.state.pose, end.costs, step, end.settled)


def strained_covariances(
    fit: MultistageFit, problem: StateProblem, pose: Pose, evaluation: LinearizedEvaluation
) -> tuple[Float, Float, Float]:
    """Covariances of the motions and of the strains, ``(n, 6, 6)`` each, and of the nuisance unknowns.

    Each is that of motions and strains estimated together.  Strains that the radiographs do not determine have the
    prior's covariance.
    """
    joint, n = with_strains(problem, pose, evaluation), len(problem.grains)
    both, nuisance = covariances(problem, pose, joint, normal_of(joint.jacobian))
    prior = fit.settings.strain_sd**2 * np.eye(6)
    strains = prior - prior @ np.linalg.inv(both[n:] + prior) @ prior
    if planar(problem.grains, problem.target.scan.geometry):
        strains[:, OUT_OF_PLANE_STRAINS, :] = strains[:, :, OUT_OF_PLANE_STRAINS] = 0
    return both[:n], strains, nuisance


def strains_by_rotations(rotations: Float, grains: GrainArrays, pose: Pose) -> Float:
    """Covariances ``(n, 6, 6)`` of strains by ``rotations (n, 3, 3)``, rad², that the radiographs do not confirm.

    They show a grain's shape as it lies in the sample.  Rotated further by δ, it has the same shape with the strain
    e + e S − S e in the frame of the reference, with S = [Ωᵀ δ]ₓ: none of a ball without strain changes.
    """
    e = tensors(strains_of(grains))[:, None]
    turned = skew_matrix(pose.matrices)  # of the rows of Ω: Ωᵀ times the axes of the sample
    changes = components(e @ turned - turned @ e)
    return np.asarray(np.einsum("nai,nab,nbj->nij", changes, rotations, changes))


def _solve(
    fit: MultistageFit, grains: GrainArrays, target: Target, start: StrainedPose, stopping: Stopping
) -> Solution[StrainedPose]:
    problem = StrainProblem(grains, target, fit.settings.strain_sd)
    return gauss_newton(problem, start, stopping, fit.observer(target, f"strains, filter {target.sigma:.2g}"))


def _stretch(fit: MultistageFit, strains: Float) -> None:
    """Give the grains of a fit these strains, for all that follows."""
    fit.grains, fit.fine_grains = (each.stretched(stretches(strains)) for each in (fit.grains, fit.fine_grains))
    fit.levels.clear()
