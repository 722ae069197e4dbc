"""Covariances of all motions, from the noise and the model error that the residuals show.

The estimate solves the normal equations A x = (F w J)ᵀ F w r, with all other unknowns eliminated from A, so its
covariance is A⁻¹ M A⁻¹ with M that of the right-hand side: the variances of the pixels, propagated through weights w
and filter F.  They are those of `noise_model.NoiseModel`: photons, an even model error and one of edges, all estimated
from the residuals.  Covariances are raised where views ask for other motions than these variances explain
(`view_disagreement`), or where a grain's own residuals exceed them (`excess_factors`), by the larger of the two.

Of many grains no inverse is taken: noise is drawn from the pixels' variances and propagated through the same
equations (`noise_draws`, `sampled_covariances`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import sparse

from grainmotion._typing import Float
from grainmotion.model.pose import Pose
from grainmotion.model.progress import counted
from grainmotion.objective.data_term import Target, gaussian
from grainmotion.objective.evaluation import Evaluation, LinearizedEvaluation
from grainmotion.objective.global_parameters import Columns
from grainmotion.objective.normal_matrix import normal_matrix
from grainmotion.objective.priors import nuisance_prior
from grainmotion.objective.residual import StateProblem
from grainmotion.projection.jacobian import PatchJacobian
from grainmotion.solvers.block_cg import Hessian, diagonal_blocks, inverse
from grainmotion.solvers.gauss_newton import Linearization
from grainmotion.solvers.semidefinite import pseudo_inverse
from grainmotion.uncertainty.goodness_of_fit import misfits
from grainmotion.uncertainty.noise_draws import NoiseDraws
from grainmotion.uncertainty.noise_model import NoiseModel, noise_model, noise_shares, open_beam
from grainmotion.uncertainty.view_disagreement import disagreement

MIN_RESIDUAL_SHARE = 2e-3
"""Smallest residual that is trusted, as a share of the radiographs' rms: voxel images are no better."""
MIN_DISCOUNT = 1e-6
"""Discount down to which variances rise."""
OUTLIER_SD = 4.0
"""Standard deviations to which residuals are cut when the model error is estimated."""
STRUCTURE_FILTER = 2.0
"""Pixels: width of the filter that separates structure from noise in unexplained residuals."""
OWN_BLOCK_DRAWS = 8.0
"""How many realisations of noise the shape of a grain's own block counts for."""
MIN_REPORTED_EIGENVALUE = 1e-6
"""Eigenvalue of the scaled normal matrices up to which a direction is reported as undetermined: its standard deviation
is 1,000 times the best one's.  The solver still steps along it, down to `semidefinite.RESOLVED_EIGENVALUE`."""


def covariances(
    problem: StateProblem, pose: Pose, evaluation: LinearizedEvaluation, hessian: Hessian
) -> tuple[Float, Float]:
    """Covariances ``(n, 6, 6)`` of (u, δ), mm and radians, and ``(k, k)`` of a liquid's and the nuisance unknowns.

    With strains after the motions in the Jacobian (`strain_problem.with_strains`) they are ``(2n, 6, 6)``.
    """
    variances, noise = pixel_variances(problem.target, evaluation), noise_variances(problem.target, evaluation)
    system = _System.of(problem, pose, evaluation, hessian)
    draws = system.draws(variances)
    grains, nuisance = system.propagated(variances, draws)
    found = disagreement(problem.target, evaluation, system.columns, draws, noise)
    trusted = ~misfits(problem, evaluation).misregistered
    factors = found.factors(np.resize(trusted, len(grains)))
    excess = np.resize(excess_factors(problem, evaluation, variances), len(grains))
    spreads = np.repeat(np.sqrt(np.maximum(factors, excess[:, None])), 3, axis=1)
    return grains * spreads[:, :, None] * spreads[:, None, :], nuisance


@dataclass(frozen=True, eq=False)
class _System:
    """The normal equations of a solution: all unknowns of the grains, and ``columns`` of the others."""

    target: Target
    evaluation: LinearizedEvaluation
    columns: Columns
    at: Linearization

    @classmethod
    def of(cls, problem: StateProblem, pose: Pose, evaluation: LinearizedEvaluation, hessian: Hessian) -> _System:
        columns = evaluation.response_columns + evaluation.nuisance_columns
        border, corner = columns.border(evaluation.jacobian), columns.gram()
        free = len(evaluation.nuisance_columns.owners)
        if free:
            corner[-free:, -free:] += nuisance_prior(problem.target, pose)[0]
        wanted = np.zeros(free + len(problem.target.fluid_columns))
        at = Linearization(evaluation.cost, np.zeros(len(border)), hessian, border, corner, wanted)
        return cls(problem.target, evaluation, columns, at)

    def draws(self, variances: Float) -> NoiseDraws:
        """Noise of given variances, and the errors that it causes."""
        return NoiseDraws.of(self.target, self.evaluation.jacobian, self.columns, self.at, variances)

    def propagated(self, variances: Float, draws: NoiseDraws) -> tuple[Float, Float]:
        """Covariances by given variances of the pixels alone."""
        if isinstance(self.at.hessian, sparse.bsr_array):
            return exact_covariances(self.target, self.evaluation, self.columns, self.at, variances)
        return sampled_covariances(self.at, draws, float(np.mean(variances)))


def exact_covariances(
    target: Target, evaluation: LinearizedEvaluation, columns: Columns, at: Linearization, variances: Float
) -> tuple[Float, Float]:
    """A⁻¹ M A⁻¹ of all grains together, and of the nuisance unknowns."""
    own, cross, of_columns = propagated_noise(target, evaluation, columns, variances)
    n, free = len(at.gradient) // 6, len(at.border_gradient)
    assert isinstance(at.hessian, sparse.bsr_array)
    hessian, noise, border, corner = at.hessian.toarray(), own.toarray(), at.border, at.corner
    across = pseudo_inverse(corner) @ border.T
    mixed = cross @ across
    noise = noise - mixed - mixed.T + across.T @ of_columns @ across
    inverse_a, undetermined = regular_inverse(hessian - border @ across)
    full = inverse_a @ noise @ inverse_a + float(np.mean(variances)) * undetermined
    grains = np.stack([full[6 * k : 6 * k + 6, 6 * k : 6 * k + 6] for k in range(n)])
    if not free:
        return grains, np.zeros((0, 0))
    across = inverse(at.hessian, 0.0)(border)
    inverse_a, _ = regular_inverse(corner - border.T @ across)
    mixed = cross.T @ across
    full = inverse_a @ (of_columns - mixed - mixed.T + across.T @ (own @ across)) @ inverse_a
    return grains, full[-free:, -free:]


def sampled_covariances(at: Linearization, draws: NoiseDraws, variance: float) -> tuple[Float, Float]:
    """As `exact_covariances`, from realisations of the noise; ``variance`` is the pixels' mean.

    With K draws, S their covariance of one grain and s G the inverse of its own block scaled to them, it is
    (K S + `OWN_BLOCK_DRAWS` s G) / (K + `OWN_BLOCK_DRAWS`): standard deviations are then right to some 10 %.
    """
    own, count = draws.errors, len(draws.errors)
    nuisance = draws.border_errors[len(draws.border_errors) - len(at.border_gradient) :].T
    informations = diagonal_blocks(at.hessian)
    alone, undetermined = zip(*(regular_inverse(block) for block in informations), strict=True)
    size: Float = (np.einsum("nij,knj->kni", informations, own) * own).sum(axis=(0, 2)) / (6 * count)
    shape = size[:, None, None] * np.array(alone)
    grains = np.einsum("kni,knj->nij", own, own) + OWN_BLOCK_DRAWS * shape
    grains = grains / (count + OWN_BLOCK_DRAWS) + variance * np.array(undetermined)
    return grains, nuisance.T @ nuisance / count


def pixel_variances(target: Target, evaluation: LinearizedEvaluation) -> Float:
    """Variance of every pixel of the radiographs, line integrals squared.

    A discounted pixel counts as if its error were alike over so many pixels that the discount makes up for them.
    """
    noise = noise_model(target, evaluation, OUTLIER_SD)  # a grain that does not fit shows nothing about the others
    least = MIN_RESIDUAL_SHARE**2 * float(np.mean(target.scan.line_integrals.astype(float) ** 2))
    variance = noise.variance(evaluation.response.apply(evaluation.line_integrals), open_beam(target)) + least
    return variance if target.discount is None else variance / np.maximum(target.discount, MIN_DISCOUNT)


def noise_variances(target: Target, evaluation: Evaluation) -> Float:
    """The part of `pixel_variances` that is noise: it does not repeat from pixel to pixel."""
    modelled = evaluation.response.apply(evaluation.line_integrals)
    unit = NoiseModel(1.0, 0.0, 0.0).photon_variance(modelled, open_beam(target))
    share, white = noise_shares(evaluation.raw_residual, unit, target.valid > 0)
    return share * unit + white


def propagated_noise(
    target: Target, evaluation: LinearizedEvaluation, columns: Columns, variances: Float
) -> tuple[sparse.bsr_array, Float, Float]:
    """Covariances of the right-hand sides: of grains ``(6n, 6n)``, of these with columns, of columns ``(m, m)``."""
    jacobian = propagating(evaluation.jacobian, target, variances)
    factor = (target.root_weights * np.sqrt(variances)).astype(target.precision)
    stacks = Columns(shared=columns.shared)
    for stack in columns.stacks:
        twice = stack.copy()
        target.backend.filter_images(twice, target.kernel)
        stacks.stacks.append(factor * twice)
    return normal_matrix(jacobian), stacks.border(jacobian), stacks.gram()


def propagating(jacobian: PatchJacobian, target: Target, variances: Float) -> PatchJacobian:
    """A filtered Jacobian J made into K, so that KᵀK is the covariance of Jᵀ F w r by the pixels' variances."""
    factor = (target.root_weights * np.sqrt(variances)).astype(target.precision)
    jacobian = jacobian.copy()
    jacobian.filter(np.ones_like(factor), target.kernel)
    jacobian.filter(factor, np.ones(1, target.precision))
    return jacobian


def excess_factors(problem: StateProblem, evaluation: LinearizedEvaluation, variances: Float) -> Float:
    """Factor on each grain's covariance for residuals beyond the variances of its pixels, at least 1, ``(n,)``.

    Residuals beyond the variances come from a broken neighbour, hardening, or the like.  They are correlated
    over as many pixels as a Gaussian filter preserves them, relative to what it preserves of noise.
    """
    smooth = evaluation.raw_residual.copy()
    kernel = gaussian(STRUCTURE_FILTER).astype(smooth.dtype)
    problem.target.backend.filter_images(smooth, kernel)
    noise_left = float((np.concatenate([kernel[:0:-1], kernel]).astype(float) ** 2).sum()) ** 2
    sums = np.zeros((len(problem.grains), 3))
    images = problem.target.trust, evaluation.raw_residual, smooth, variances
    per_grain = counted(evaluation.grain_pixels(*images), len(evaluation.patches.boxes))
    for grain, own, (good, residual, smoothed, variance) in per_grain:
        weight = np.abs(own) * good
        squares = [weight @ image.astype(float) ** 2 for image in (residual, smoothed)]
        sums[grain] += *squares, weight @ variance
    raw, structured, expected = np.maximum(sums.T, 1e-300)
    correlated = np.maximum(1.0, structured / (noise_left * raw))
    return 1.0 + np.maximum(0.0, raw / expected - 1.0) * correlated


def regular_inverse(matrix: Float) -> tuple[Float, Float]:
    """Inverse after scaling to unit diagonal, and its share along undetermined directions: huge, not an error."""
    scale = np.sqrt(np.maximum(np.diagonal(matrix), 1e-30))
    values, vectors = np.linalg.eigh(matrix / np.outer(scale, scale))
    undetermined = values < MIN_REPORTED_EIGENVALUE
    values = np.maximum(values, MIN_REPORTED_EIGENVALUE)
    share = (vectors[:, undetermined] / values[undetermined]) @ vectors[:, undetermined].T
    return (vectors / values) @ vectors.T / np.outer(scale, scale), share / np.outer(scale, scale)
