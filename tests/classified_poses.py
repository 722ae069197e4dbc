"""Helpers that classify a given pose as if the solver had ended there: for tests of statuses and covariances."""

import numpy as np

from few_grains import GAIN_AND_OFFSET, VOXEL, grain_set, small_motions
from grainmotion.model.pose import Pose
from grainmotion.objective.data_term import Target
from grainmotion.objective.normal_matrix import normal_matrix
from grainmotion.objective.residual import StateProblem
from grainmotion.objective.response_parameters import ResponseModel
from grainmotion.projection.grain_arrays import GrainArrays
from grainmotion.solvers.gauss_newton import Solution
from grainmotion.tracking.classification import classify
from grainmotion.tracking.refinement import RefinedFit
from grainmotion.uncertainty.covariance import covariances
from grainmotion.uncertainty.rotation_identifiability import unconfirmed_rotations
from grainmotion.uncertainty.weak_directions import weak_directions

LIMITS = (0.5 * VOXEL, np.deg2rad(5.0))


def shared_grains():
    """The grains of all these tests."""
    return grain_set()


def shared_truth():
    """Their motions."""
    return small_motions(shared_grains())


def pose_of(truth):
    return Pose(truth.translations, truth.matrices)


def problem_of(scan, grains=None, sigma=0.7, gain=True):
    target = Target(
        scan,
        np.zeros(scan.line_integrals.shape, np.float32),
        "trilinear",
        sigma,
        GAIN_AND_OFFSET if gain else ResponseModel(),
    )
    return StateProblem(GrainArrays.of(grains or shared_grains(), fine=True), target)


def classified(scan, pose, grains=None, limits=LIMITS, settled=True, last_step=None, ambiguous=None, **target):
    """Motions and statuses of a pose, as if the solver had ended there."""
    grains = grains or shared_grains()
    problem = problem_of(scan, grains, **target)
    at = problem.linearize(pose)
    step = np.zeros(6 * len(grains)) if last_step is None else last_step
    solution = Solution(pose, (at.cost,), step, settled)
    ambiguous = np.zeros(len(grains), dtype=bool) if ambiguous is None else ambiguous
    return classify(grains, refined(problem, solution), ambiguous, limits, (("free", 0.1), ("free", 0.05)))


def refined(problem, solution):
    """A solution with its covariances; no direction has a prior."""
    evaluation = problem.evaluate_with_derivatives(solution.state)
    hessian = normal_matrix(evaluation.jacobian)
    covariance_blocks, _ = covariances(problem, solution.state, evaluation, hessian)
    covariance_blocks[:, 3:, 3:] += unconfirmed_rotations(problem, solution.state, evaluation)
    return RefinedFit(
        problem, solution, covariance_blocks, weak_directions(covariance_blocks, problem.grains).posterior()
    )
