"""Covariances of all motions, from the noise and the model error that the residuals show.

The estimate solves the normal equations A x = (F w J)ᵀ F w r, with all other unknowns eliminated from A, so its
covariance is A⁻¹ M A⁻¹ with M that of the right-hand side: the variances of the pixels, propagated through weights w
and filter F.  They are those of `noise_model.NoiseModel`: photons, an even model error and one of edges, all estimated
from the residuals.  A grain whose own residuals exceed these variances has its covariance raised (`excess_factors`).

Of many grains no inverse is taken: noise is drawn from the pixels' variances and propagated through the same
equations (`sampled_covariances`), `NOISE_DRAWS` times.
"""

from __future__ import annotations

import numpy as np
from scipy import sparse

from grainmotion._typing import Float
from grainmotion.model.pose import Pose
from grainmotion.objective.data_term import Target, gaussian
from grainmotion.objective.evaluation import LinearizedEvaluation
from grainmotion.objective.global_parameters import Columns
from grainmotion.objective.normal_matrix import normal_matrix
from grainmotion.objective.priors import nuisance_prior
from grainmotion.objective.residual import StateProblem
from grainmotion.projection.jacobian import PatchJacobian
from grainmotion.solvers.block_cg import Hessian, conjugate_gradients, diagonal_blocks, inverse
from grainmotion.solvers.gauss_newton import Linearization, schur_complement
from grainmotion.solvers.semidefinite import pseudo_inverse
from grainmotion.uncertainty.noise_model import noise_model, open_beam

MIN_RESIDUAL_SHARE = 2e-3
"""Smallest residual that is trusted, as a share of the radiographs' rms: voxel images are no better."""
OUTLIER_SD = 4.0
"""Standard deviations to which residuals are cut when the model error is estimated."""
STRUCTURE_FILTER = 2.0
"""Pixels: width of the filter that separates structure from noise in unexplained residuals."""
NOISE_DRAWS, OWN_BLOCK_DRAWS = 16, 8.0
"""Realisations of noise for many grains, and how many of them the shape of a grain's own block counts for."""
NOISE_SOLVE_TOLERANCE = 3e-3
"""Relative residual to which the equations of each realisation are solved."""
MIN_REPORTED_EIGENVALUE = 1e-6
"""Eigenvalue of the scaled normal matrices up to which a direction is reported as undetermined: its standard deviation
is 1,000 times the best one's.  The solver still steps along it, down to `semidefinite.RESOLVED_EIGENVALUE`."""


def covariances(
    problem: StateProblem, pose: Pose, evaluation: LinearizedEvaluation, hessian: Hessian
) -> tuple[Float, Float]:
    """Covariances ``(n, 6, 6)`` of (u, δ), mm and radians, and ``(k, k)`` of the nuisance unknowns.

    With strains after the motions in the Jacobian (`strain_problem.with_strains`) they are ``(2n, 6, 6)``.
    """
    variances = pixel_variances(problem.target, evaluation)
    grains, nuisance = propagated_covariances(problem, pose, evaluation, hessian, variances)
    factors = np.resize(excess_factors(problem, evaluation, variances), len(grains))
    return grains * factors[:, None, None], nuisance


def propagated_covariances(
    problem: StateProblem, pose: Pose, evaluation: LinearizedEvaluation, hessian: Hessian, variances: Float
) -> tuple[Float, Float]:
    """The same by given variances of the pixels alone; 2n blocks ``(2n, 6, 6)`` if strains follow the motions."""
    columns = evaluation.response_columns + evaluation.nuisance_columns
    border, corner = columns.border(evaluation.jacobian), columns.gram()
    free = len(evaluation.nuisance_columns.owners)
    if free:
        corner[-free:, -free:] += nuisance_prior(problem.target, pose)[0]
    at = Linearization(evaluation.cost, np.zeros(len(border)), hessian, border, corner, np.zeros(free))
    estimate = exact_covariances if isinstance(hessian, sparse.bsr_array) else sampled_covariances
    return estimate(problem.target, evaluation, columns, at, variances)


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


def sampled_covariances(
    target: Target, evaluation: LinearizedEvaluation, columns: Columns, at: Linearization, variances: Float
) -> tuple[Float, Float]:
    """As `exact_covariances`, from realisations of the noise.

    With K draws, S their covariance of one grain and s G the inverse of its own block scaled to them, it is
    (K S + `OWN_BLOCK_DRAWS` s G) / (K + `OWN_BLOCK_DRAWS`): standard deviations are then right to some 10 %.
    """
    n, free = len(at.gradient) // 6, len(at.border_gradient)
    product, corner_inverse, blocks = schur_complement(at, 0.0)
    rng, spreads = np.random.default_rng(0), np.sqrt(variances)
    noise = Columns()
    for _ in range(NOISE_DRAWS):
        drawn = spreads * rng.standard_normal(spreads.shape)
        noise.add(target.filtered(drawn.astype(target.precision)), shared=True)
    on_columns = np.array([columns.dot(images) for images in noise.stacks]).T
    right = noise.border(evaluation.jacobian) - at.border @ (corner_inverse @ on_columns)
    errors = conjugate_gradients(product, blocks, right, NOISE_SOLVE_TOLERANCE)
    own = errors.T.reshape(NOISE_DRAWS, n, 6)
    nuisance = (corner_inverse @ (on_columns - at.border.T @ errors))[len(on_columns) - free :].T
    informations = diagonal_blocks(at.hessian)
    alone, undetermined = zip(*(regular_inverse(block) for block in informations), strict=True)
    size: Float = (np.einsum("nij,knj->kni", informations, own) * own).sum(axis=(0, 2)) / (6 * NOISE_DRAWS)
    shape = size[:, None, None] * np.array(alone)
    grains = np.einsum("kni,knj->nij", own, own) + OWN_BLOCK_DRAWS * shape
    grains = grains / (NOISE_DRAWS + OWN_BLOCK_DRAWS) + float(np.mean(variances)) * np.array(undetermined)
    return grains, nuisance.T @ nuisance / NOISE_DRAWS


def pixel_variances(target: Target, evaluation: LinearizedEvaluation) -> Float:
    """Variance of every pixel of the radiographs, line integrals squared."""
    noise = noise_model(target, evaluation, OUTLIER_SD)  # a grain that does not fit shows nothing about the others
    least = MIN_RESIDUAL_SHARE**2 * float(np.mean(target.scan.line_integrals.astype(float) ** 2))
    return noise.variance(evaluation.response.apply(evaluation.line_integrals), open_beam(target)) + least


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
    valid = problem.target.valid
    smooth = evaluation.raw_residual.copy()
    kernel = gaussian(STRUCTURE_FILTER).astype(smooth.dtype)
    problem.target.backend.filter_images(smooth, kernel)
    noise_left = float((np.concatenate([kernel[:0:-1], kernel]).astype(float) ** 2).sum()) ** 2
    sums = np.zeros((len(problem.grains), 3))
    images = valid, evaluation.raw_residual, smooth, variances
    for grain, own, (good, residual, smoothed, variance) in evaluation.grain_pixels(*images):
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
