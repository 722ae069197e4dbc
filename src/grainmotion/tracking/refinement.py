"""Polish: the last solutions of a state, once every grain is near its place.

Views get poses of their own if they can be told from the sample's motion; pixels get weights, iterated until
they are consistent with the residuals; grains that the views hardly see are held by a prior.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy import sparse

from grainmotion._typing import Float
from grainmotion.model.pose import Pose, ViewCorrections
from grainmotion.objective.normal_matrix import PatchNormalMatrix, normal_of
from grainmotion.objective.residual import StateProblem
from grainmotion.projection.grain_arrays import OUT_OF_PLANE, GrainArrays, planar
from grainmotion.solvers.gauss_newton import Solution
from grainmotion.tracking.multistage import MultistageFit
from grainmotion.tracking.view_alignment import (
    ViewMisalignment,
    alignment_refusal,
    common_motion,
    view_misalignment,
    with_view_poses,
)
from grainmotion.uncertainty.covariance import covariances
from grainmotion.uncertainty.noise_model import reweighted
from grainmotion.uncertainty.rotation_identifiability import unconfirmed_rotations
from grainmotion.uncertainty.weak_directions import weak_directions

MAX_PRIOR_COST_RATIO = 1.02
"""Times the cost, up to which holding weak directions may leave a fit worse."""
REWEIGHTING_ROUNDS = 3
"""Solutions with new weights; the likelihood of some 20 counts a pixel or fewer would want more."""


@dataclass(frozen=True, eq=False)
class RefinedFit:
    """The last problem and its solution, with their uncertainty.

    ``covariances (n, 6, 6)`` of (u, δ) are what the radiographs tell, ``posterior`` the same with the prior that
    held weak directions; ``corrections_sd`` go with poses of views; ``downweighted`` is the share of
    pixels that a robust loss counted less.
    """

    problem: StateProblem
    solution: Solution[Pose]
    covariances: Float
    posterior: Float
    corrections_sd: ViewCorrections | None = None
    downweighted: float = 0.0
    notes: tuple[str, ...] = ()


def refine(fit: MultistageFit, base: Pose, problem: StateProblem, solution: Solution[Pose]) -> RefinedFit:
    """Refine a solution in which all grains are near; ``base`` is where the smooth field put them."""
    settings, notes, share = fit.settings, list[str](), 0.0
    stopping = fit.fine_stopping()
    misalignment = ViewMisalignment()
    if settings.view_corrections != "never" and not planar(problem.grains, problem.target.scan.geometry):
        misalignment = view_misalignment(problem, solution.state)
        if settings.view_corrections == "always" or misalignment.clearly:
            refusal = alignment_refusal(problem, solution.state)
            notes += [misalignment.note] * misalignment.clearly + [refusal] * bool(refusal)
            if not refusal:
                problem = with_view_poses(problem, solution.state)
                solution = fit.solve(problem, solution.state, stopping, "poses of views")
    if settings.weights != "uniform" or settings.loss != "squares":
        plain = problem.target
        for k in range(REWEIGHTING_ROUNDS):
            # the working response of a likelihood replaces the radiographs, so residuals are taken from these
            evaluation = replace(problem, target=replace(plain, weights=problem.target.weights)).evaluate(
                solution.state
            )
            target, share = reweighted(plain, evaluation, settings.weights, settings.loss)
            problem = replace(problem, target=target)
            solution = fit.solve(problem, solution.state, stopping, f"weights {k + 1}")
        if settings.loss == "poisson":  # the working response is no radiograph: what follows compares with these
            problem = replace(problem, target=replace(plain, weights=problem.target.weights, sigma=0.0))
    known, few, formal = _covariances(problem, fit.grains, solution.state)
    if misalignment.clearly:
        known += common_motion(problem, solution.state, misalignment)
    weak, posterior = weak_directions(known, problem.grains), known
    if weak.flags.any():
        held = replace(problem, prior=weak.prior(formal, base))
        end = fit.solve(held, solution.state, stopping, "weak directions held")
        if problem.cost(end.state) < MAX_PRIOR_COST_RATIO * problem.cost(solution.state):
            solution, posterior = end, weak.posterior()  # else the radiographs know better than they let on
    corrections_sd = None
    if problem.target.nuisance.views:
        views = len(problem.target.scan)
        corrections_sd = ViewCorrections.of(np.sqrt(np.diagonal(few))[: 3 * views].reshape(3, views).T)
    return RefinedFit(problem, solution, known, posterior, corrections_sd, share, tuple(notes))


def _covariances(
    problem: StateProblem, coarse: GrainArrays, pose: Pose
) -> tuple[Float, Float, sparse.bsr_array | PatchNormalMatrix]:
    """What the radiographs tell of the grains ``(n, 6, 6)`` and of the nuisance unknowns ``(k, k)``; JᵀJ."""
    evaluation = problem.evaluate_with_derivatives(pose)
    formal = normal_of(evaluation.derivatives, evaluation.patches, len(problem.grains), evaluation.residual.shape)
    grains, few = covariances(problem, pose, evaluation, formal)
    # a turn that either set of voxels leaves unconfirmed is: finer ones follow their own pattern more closely
    grains[:, 3:, 3:] += unconfirmed_rotations(problem, pose, evaluation)
    if coarse.voxel_size > problem.grains.voxel_size:
        grains[:, 3:, 3:] += unconfirmed_rotations(replace(problem, grains=coarse), pose, evaluation)
    if planar(problem.grains, problem.target.scan.geometry):
        grains[:, OUT_OF_PLANE, :] = grains[:, :, OUT_OF_PLANE] = 0
    return grains, few, formal
