"""The last solutions of a state, once every grain is near its place.

The views are aligned if their poses can be identified beside the sample's motion; pixels get weights, iterated until
they are consistent with the residuals; directions in which the views hardly determine a grain are fixed by a prior.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from grainmotion._typing import Float
from grainmotion.model.pose import Pose, ViewCorrections
from grainmotion.objective.evaluation import Evaluation
from grainmotion.objective.normal_matrix import PatchNormalMatrix, normal_of
from grainmotion.objective.priors import MotionPrior
from grainmotion.objective.residual import StateProblem
from grainmotion.projection.grain_arrays import OUT_OF_PLANE, planar
from grainmotion.solvers.block_cg import diagonal_blocks
from grainmotion.solvers.gauss_newton import Solution, gauss_newton
from grainmotion.tracking.body_motions import body_covariances
from grainmotion.tracking.multistage import MultistageFit
from grainmotion.tracking.strain_stages import refine_strains, strained_covariances, strains_by_rotations
from grainmotion.tracking.view_alignment import (
    ViewMisalignment,
    alignment_refusal,
    common_motion,
    view_misalignment,
    with_view_poses,
)
from grainmotion.uncertainty.covariance import covariances
from grainmotion.uncertainty.noise_model import reweighted
from grainmotion.uncertainty.rotation_identifiability import shifts_by_rotations, unconfirmed_rotations
from grainmotion.uncertainty.weak_directions import WeakDirections, weak_directions

MAX_PRIOR_COST_RATIO = 1.02
"""Times the cost, up to which the prior on weak directions may leave a fit worse."""
REWEIGHTING_ROUNDS = 3
"""Solutions with new weights; the likelihood of some 20 counts a pixel or fewer would want more."""


@dataclass(frozen=True, eq=False)
class Alignment:
    """What was found out about the poses of the views; the unknowns of ``problem`` hold them if they are solved for."""

    problem: StateProblem
    misalignment: ViewMisalignment = field(default_factory=ViewMisalignment)
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class RefinedFit:
    """The last problem and its solution, with their uncertainty.

    ``covariances (n, 6, 6)`` of (u, δ), mm and radians, are from the radiographs alone, ``posterior`` are the same with
    the prior on weak directions; ``strain_covariances (n, 6, 6)`` are those of the strains, None for rigid grains;
    ``corrections_sd`` are of the views' poses, ``body_covariances (k, 6, 6)`` of the bodies' motions; ``downweighted``
    is the share of pixels that a robust loss counted less; ``fluid_covariance`` is of a liquid's unknowns.  ``prior``
    is the one on weak directions, None if nothing is held, ``weak_numbers (n,)`` how many each grain has,
    ``free_cost`` the least cost without the prior, and ``unconfirmed (n, 3, 3)`` are the covariances of rotations that
    the radiographs do not confirm, rad².
    """

    problem: StateProblem
    solution: Solution[Pose]
    covariances: Float
    posterior: Float
    strain_covariances: Float | None = None
    corrections_sd: ViewCorrections | None = None
    downweighted: float = 0.0
    fluid_covariance: Float | None = None
    notes: tuple[str, ...] = ()
    body_covariances: Float = field(default_factory=lambda: np.zeros((0, 6, 6)))
    prior: MotionPrior | None = None
    weak_numbers: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    free_cost: float = np.inf
    unconfirmed: Float = field(default_factory=lambda: np.zeros((0, 3, 3)))

    @cached_property
    def evaluation(self) -> Evaluation:
        """The radiographs simulated and compared at the solution."""
        return self.problem.evaluate(self.solution.state)


def refine(
    fit: MultistageFit,
    field_pose: Pose,
    alignment: Alignment,
    solution: Solution[Pose],
    before: RefinedFit | None = None,
    moved: NDArray[np.bool_] | None = None,
) -> RefinedFit:
    """Refine a solution in which all grains are near; ``field_pose`` is where the smooth field put them.

    ``before`` is an earlier refinement, after which the grains ``moved (n,)`` went to another pose and all were solved
    again; weak directions are held anew if those grains have more of them than before.
    """
    problem = alignment.problem
    if before is not None:
        problem = replace(before.problem, target=problem.target, prior=before.prior)
    problem, solution, downweighted = _reweight(fit, problem, solution)
    if fit.settings.strain:
        problem, solution = refine_strains(fit, problem, solution)
    prior, problem = problem.prior, replace(problem, prior=None)
    known = None if before is None or moved is None else (before.unconfirmed, moved)
    uncertain = _uncertainty(fit, alignment, problem, solution.state, known)
    if solution.paused and not uncertain.weak.flags.any():
        solution = gauss_newton(
            problem, solution.state, fit.fine_stopping(), fit.observer(problem.target, "free, to the end")
        )
        uncertain = _uncertainty(fit, alignment, problem, solution.state, known)
    weak, posterior = uncertain.weak, uncertain.covariances
    numbers, free_cost = weak.flags.sum(axis=1), before.free_cost if before else np.inf
    if before and prior is not None and (numbers <= before.weak_numbers)[moved].all():
        posterior, numbers = weak.posterior(), before.weak_numbers
        if fit.many:  # fewer are settled by now
            held = replace(problem, prior=prior)
            observe = fit.observer(held.target, "weak directions held")
            stopping = fit.held_stopping(held.target, again=True)
            solution = gauss_newton(held, solution.state, stopping, observe)
    elif numbers.any():
        free_cost = min(free_cost, problem.cost(solution.state))
        new_prior = weak.prior(uncertain.hessian, field_pose)
        if moved is not None and prior is not None:
            new_prior = prior.replaced(new_prior, moved)
        held = replace(problem, prior=new_prior)
        observe = fit.observer(held.target, "weak directions held")
        stopping = fit.held_stopping(held.target, again=before is not None)
        end = gauss_newton(held, solution.state, stopping, observe)
        # if the prior raises the cost by more, the radiographs determine more than the covariances show
        if problem.cost(end.state) < MAX_PRIOR_COST_RATIO * free_cost:
            solution, posterior, prior = end, weak.posterior(), held.prior
        elif prior is not None:  # the earlier one still holds them
            posterior = weak.posterior()
        elif solution.paused:
            observe = fit.observer(problem.target, "free, to the end")
            solution = gauss_newton(problem, solution.state, fit.held_stopping(problem.target), observe)
    corrections_sd = None
    if problem.target.nuisance.views:
        views = len(problem.target.scan)
        sd = np.sqrt(np.diagonal(uncertain.nuisance))[: 3 * views]
        corrections_sd = ViewCorrections.of(sd.reshape(3, views).T)
    return RefinedFit(
        problem, solution, uncertain.covariances, posterior, uncertain.strains, corrections_sd, downweighted,
        uncertain.fluid, alignment.notes, body_covariances(problem, solution.state, uncertain.nuisance), prior,
        numbers, free_cost, uncertain.unconfirmed,
    )  # fmt: skip


def align_views(
    fit: MultistageFit, problem: StateProblem, solution: Solution[Pose]
) -> tuple[Alignment, Solution[Pose]]:
    """Solve for the views' poses too if the settings say so, or if the views contradict each other."""
    corrections = fit.settings.view_corrections
    if corrections == "never" or planar(problem.grains, problem.target.scan.geometry):
        return Alignment(problem), solution
    misalignment = view_misalignment(problem, solution.state)
    if corrections != "always" and not misalignment.significant:
        return Alignment(problem, misalignment), solution
    refusal = alignment_refusal(problem, solution.state)
    notes = [misalignment.note] * misalignment.significant + [refusal] * bool(refusal)
    if not refusal:
        problem = with_view_poses(problem, solution.state)
        observe = fit.observer(problem.target, "poses of views")
        solution = gauss_newton(problem, solution.state, fit.fine_stopping(), observe)
    return Alignment(problem, misalignment, tuple(notes)), solution


def _reweight(
    fit: MultistageFit, problem: StateProblem, solution: Solution[Pose]
) -> tuple[StateProblem, Solution[Pose], float]:
    """Solve with the weights of the settings, and the share of pixels that a robust loss counts less."""
    settings, plain, downweighted = fit.settings, problem.target, 0.0
    if settings.weights == "uniform" and settings.loss == "squares":
        return problem, solution, downweighted
    for k in range(REWEIGHTING_ROUNDS):
        # The working response of a likelihood replaces the radiographs, but residuals are taken from these.
        with_radiographs = replace(problem, target=replace(plain, weights=problem.target.weights))
        evaluation = with_radiographs.evaluate(solution.state)
        target, downweighted = reweighted(plain, evaluation, settings.weights, settings.loss)
        problem = replace(problem, target=target)
        observe = fit.observer(problem.target, f"weights {k + 1}")
        solution = gauss_newton(problem, solution.state, fit.fine_stopping(), observe)
    if settings.loss == "poisson":  # covariances and statuses need the radiographs again
        problem = replace(problem, target=replace(plain, weights=problem.target.weights, sigma=0.0))
    return problem, solution, downweighted


@dataclass(frozen=True, eq=False)
class _Uncertainty:
    """Covariances of motions and of strains ``(n, 6, 6)``, of the unknowns of a liquid and of the nuisance motions
    ``(k, k)``, of rotations that the radiographs do not confirm ``(n, 3, 3)``, the weak directions of each grain, and
    JᵀJ.
    """

    covariances: Float
    strains: Float | None
    fluid: Float
    nuisance: Float
    unconfirmed: Float
    weak: WeakDirections
    hessian: sparse.bsr_array | PatchNormalMatrix


def _uncertainty(
    fit: MultistageFit,
    alignment: Alignment,
    problem: StateProblem,
    pose: Pose,
    known: tuple[Float, NDArray[np.bool_]] | None = None,
) -> _Uncertainty:
    """How far the radiographs determine the unknowns of a problem at its solution.

    ``known`` are the covariances of unconfirmed rotations before some grains moved, and which of them did ``(n,)``.
    """
    evaluation, strains = problem.evaluate_with_derivatives(pose), None
    hessian = normal_of(evaluation.jacobian)
    if fit.settings.strain:
        own, strains, nuisance = strained_covariances(fit, problem, pose, evaluation)
    else:
        own, nuisance = covariances(problem, pose, evaluation, hessian)
    if known is None:
        free = _unconfirmed(fit, problem, pose, evaluation)
    else:
        free, rows = known[0].copy(), np.flatnonzero(known[1])
        free[rows] = _unconfirmed(fit, problem, pose, evaluation, rows)
    own[:, 3:, 3:] += free
    own[:, :3, :3] += shifts_by_rotations(free, diagonal_blocks(hessian))
    if strains is not None:
        strains += strains_by_rotations(free, problem.grains, pose)
    if planar(problem.grains, problem.target.scan.geometry):
        own[:, OUT_OF_PLANE, :] = own[:, :, OUT_OF_PLANE] = 0
    if alignment.misalignment.significant:
        own += common_motion(problem, pose, alignment.misalignment)
    fluid, weak = len(problem.target.fluid_columns), weak_directions(own, problem.grains)
    return _Uncertainty(own, strains, nuisance[:fluid, :fluid], nuisance[fluid:, fluid:], free, weak, hessian)


def _unconfirmed(
    fit: MultistageFit,
    problem: StateProblem,
    pose: Pose,
    evaluation: Evaluation,
    rows: NDArray[np.int64] | None = None,
) -> Float:
    """Covariances ``(n, 3, 3)`` of rotations that either set of voxels leaves unconfirmed, rad², or those of ``rows``.

    Finer voxels follow their own pattern more closely.
    """
    free = unconfirmed_rotations(problem, pose, evaluation, rows)
    if fit.grains.voxel_size > problem.grains.voxel_size:
        free = free + unconfirmed_rotations(replace(problem, grains=fit.grains), pose, evaluation, rows)
    return free
