"""Covariances of all motions, from the noise and the model error that the residuals show.

The estimate solves the normal equations A x = (F w J)ᵀ F w r, with all else that was estimated eliminated from
A, so its covariance is A⁻¹ M A⁻¹ with M that of the right-hand side: the variances of the pixels, carried
through weights w and filter F.  They are those of `noise_model.NoiseModel`: photons, an even model error and one of
edges, all estimated from the residuals.  A grain whose own residuals exceed these variances has its covariance
raised (`excess_factors`).

Of many grains no inverse is taken: noise is drawn from the pixels' variances and carried through the same equations
(`sampled_covariances`), `NOISE_DRAWS` times.
"""

from __future__ import annotations

import numpy as np
from scipy import sparse

from grainmotion._typing import Float
from grainmotion.backends.patchwork import filter_images, filter_patches
from grainmotion.model.pose import Pose
from grainmotion.objective.data_term import Target, gaussian
from grainmotion.objective.evaluation import LinearizedEvaluation
from grainmotion.objective.global_parameters import Columns
from grainmotion.objective.normal_matrix import normal_matrix
from grainmotion.objective.priors import nuisance_prior
from grainmotion.objective.residual import StateProblem
from grainmotion.solvers.block_cg import Hessian, conjugate_gradients, diagonal_blocks, inverse
from grainmotion.solvers.gauss_newton import Linearization, schur_complement
from grainmotion.solvers.semidefinite import pseudo_inverse
from grainmotion.uncertainty.noise_model import noise_model, open_beam

MIN_RESIDUAL_SHARE = 2e-3
"""Of the radiographs' rms: no residual is trusted to be smaller; no radiograph and no voxel image is better."""
OUTLIER_SD = 4.0
"""Standard deviations to which residuals are cut when the model error is estimated."""
STRUCTURE_FILTER = 2.0
"""Pixels: width of the filter that tells structure from noise in what is left unexplained."""
NOISE_DRAWS, OWN_BLOCK_DRAWS = 16, 8.0
"""Noises drawn for many grains; draws that the shape of a grain's own block counts for, its size being drawn."""
NOISE_SOLVE_TOLERANCE = 3e-3
"""Relative residual to which each is solved."""
MIN_REPORTED_EIGENVALUE = 1e-6
"""Eigenvalue of the scaled normal matrices up to which a direction is reported as unseen: its standard deviation is
1,000 times the best one's.  The solver still steps along it, down to `semidefinite.RESOLVED_EIGENVALUE`."""


def covariances(
    problem: StateProblem, pose: Pose, evaluation: LinearizedEvaluation, hessian: Hessian
) -> tuple[Float, Float]:
    """Covariances ``(n, 6, 6)`` of (u, δ), mm and radians, and ``(k, k)`` of the nuisance unknowns."""
    n, columns = len(problem.grains), evaluation.response_columns + evaluation.nuisance_columns
    border, corner = columns.border(evaluation.derivatives, evaluation.patches, n), columns.gram()
    free = len(evaluation.nuisance_columns.owners)
    if free:
        corner[-free:, -free:] += nuisance_prior(problem.target, pose)[0]
    variances = pixel_variances(problem.target, evaluation)
    at = Linearization(evaluation.cost, np.zeros(6 * n), hessian, border, corner, np.zeros(free))
    find = exact_covariances if isinstance(hessian, sparse.bsr_array) else sampled_covariances
    out, few = find(problem.target, evaluation, columns, at, variances)
    return out * excess_factors(problem, evaluation, variances)[:, None, None], few


def exact_covariances(
    target: Target, evaluation: LinearizedEvaluation, columns: Columns, at: Linearization, variances: Float
) -> tuple[Float, Float]:
    """A⁻¹ M A⁻¹ of all grains together, and of what steps beside them."""
    own, both, few = propagated_noise(target, evaluation, columns, variances)
    n, free = len(at.gradient) // 6, len(at.border_gradient)
    hessian, meat, border, corner = (np.asarray(m) for m in (_dense(at.hessian), _dense(own), at.border, at.corner))
    across = pseudo_inverse(corner) @ border.T
    mixed = both @ across
    meat = meat - mixed - mixed.T + across.T @ few @ across
    bread, unseen = regular_inverse(hessian - border @ across)
    full = bread @ meat @ bread + float(np.mean(variances)) * unseen
    out = np.stack([full[6 * k : 6 * k + 6, 6 * k : 6 * k + 6] for k in range(n)])
    if not free:
        return out, np.zeros((0, 0))
    across = inverse(at.hessian, 0.0)(border)
    left, _ = regular_inverse(corner - border.T @ across)
    mixed = both.T @ across
    full = left @ (few - mixed - mixed.T + across.T @ (own @ across)) @ left
    return out, full[-free:, -free:]


def sampled_covariances(
    target: Target, evaluation: LinearizedEvaluation, columns: Columns, at: Linearization, variances: Float
) -> tuple[Float, Float]:
    """The same from noise that is drawn.

    With K draws, S their covariance of one grain and s G the inverse of its own block scaled to them, it is
    (K S + `OWN_BLOCK_DRAWS` s G) / (K + `OWN_BLOCK_DRAWS`): standard deviations are then right to some 10 %.
    """
    n, free = len(at.gradient) // 6, len(at.border_gradient)
    product, few, blocks = schur_complement(at, 0.0)
    rng, spreads = np.random.default_rng(0), np.sqrt(variances)
    noise = Columns()
    for _ in range(NOISE_DRAWS):
        drawn = spreads * rng.standard_normal(spreads.shape)
        noise.add(target.filtered(drawn.astype(target.precision)), shared=True)
    slopes = np.array([columns.dot(images) for images in noise.stacks]).T
    pulls = noise.border(evaluation.derivatives, evaluation.patches, n) - at.border @ (few @ slopes)
    found = conjugate_gradients(product, blocks, pulls, NOISE_SOLVE_TOLERANCE)
    own = found.T.reshape(NOISE_DRAWS, n, 6)
    beside = (few @ (slopes - at.border.T @ found))[len(slopes) - free :].T
    informations = diagonal_blocks(at.hessian)
    alone, unseen = zip(*(regular_inverse(block) for block in informations), strict=True)
    size: Float = (np.einsum("nij,knj->kni", informations, own) * own).sum(axis=(0, 2)) / (6 * NOISE_DRAWS)
    shape = size[:, None, None] * np.array(alone)
    out = (np.einsum("kni,knj->nij", own, own) + OWN_BLOCK_DRAWS * shape) / (NOISE_DRAWS + OWN_BLOCK_DRAWS)
    return out + float(np.mean(variances)) * np.array(unseen), beside.T @ beside / NOISE_DRAWS


def _dense(matrix: Hessian) -> Float:
    return matrix.toarray() if isinstance(matrix, sparse.bsr_array) else np.asarray(matrix)


def pixel_variances(target: Target, evaluation: LinearizedEvaluation) -> Float:
    """Variance of every pixel of the radiographs, line integrals squared."""
    noise = noise_model(target, evaluation, OUTLIER_SD)  # a grain that does not fit says nothing of the others
    least = MIN_RESIDUAL_SHARE**2 * float(np.mean(target.scan.line_integrals.astype(float) ** 2))
    return noise.variance(evaluation.response.apply(evaluation.line_integrals), open_beam(target)) + least


def propagated_noise(
    target: Target, evaluation: LinearizedEvaluation, columns: Columns, variances: Float
) -> tuple[sparse.bsr_array, Float, Float]:
    """Covariances of the right-hand sides: of grains ``(6n, 6n)``, of these with columns, of columns ``(m, m)``."""
    factor = (target.root_weights * np.sqrt(variances)).astype(target.precision)
    again = evaluation.derivatives.copy()
    boxes, offsets = evaluation.patches.boxes, evaluation.patches.offsets
    filter_patches(again, boxes, offsets, np.ones_like(factor), target.kernel)
    filter_patches(again, boxes, offsets, factor, np.ones(1, target.precision))
    stacks = Columns(shared=columns.shared)
    for stack in columns.stacks:
        twice = stack.copy()
        filter_images(twice, target.kernel, target.device)
        stacks.stacks.append(factor * twice)
    n = int(boxes[:, 0].max(initial=-1)) + 1
    n = max(n, len(evaluation.patches.seen))
    return normal_matrix(again, evaluation.patches, n), stacks.border(again, evaluation.patches, n), stacks.gram()


def excess_factors(problem: StateProblem, evaluation: LinearizedEvaluation, variances: Float) -> Float:
    """Factor on each grain's covariance for residuals beyond the variances of its pixels, at least 1, ``(n,)``.

    What is beyond them is no noise but a broken neighbour, hardening, or the like, and correlated over as many
    pixels as a Gaussian filter leaves it standing, against what it leaves of noise.
    """
    valid = problem.target.valid
    smooth = evaluation.raw_residual.copy()
    kernel = gaussian(STRUCTURE_FILTER).astype(smooth.dtype)
    filter_images(smooth, kernel, problem.target.device)
    left_of_noise = float((np.concatenate([kernel[:0:-1], kernel]).astype(float) ** 2).sum()) ** 2
    sums = np.zeros((len(problem.grains), 3))
    for p, (grain, view, r0, r1, c0, c1) in enumerate(evaluation.patches.boxes):
        own = evaluation.values[evaluation.patches.offsets[p] : evaluation.patches.offsets[p + 1]].astype(float)
        weight = np.abs(own) * valid[view, r0:r1, c0:c1].ravel()
        for k, image in enumerate((evaluation.raw_residual, smooth)):
            sums[grain, k] += weight @ image[view, r0:r1, c0:c1].ravel().astype(float) ** 2
        sums[grain, 2] += weight @ variances[view, r0:r1, c0:c1].ravel()
    squares, smoothed, expected = np.maximum(sums.T, 1e-300)
    correlated = np.maximum(1.0, smoothed / (left_of_noise * squares))
    return 1.0 + np.maximum(0.0, squares / expected - 1.0) * correlated


def regular_inverse(matrix: Float) -> tuple[Float, Float]:
    """Inverse after scaling to unit diagonal, and what of it belongs to unseen directions: huge, not an error."""
    scale = np.sqrt(np.maximum(np.diagonal(matrix), 1e-30))
    values, vectors = np.linalg.eigh(matrix / np.outer(scale, scale))
    unseen = values < MIN_REPORTED_EIGENVALUE
    values = np.maximum(values, MIN_REPORTED_EIGENVALUE)
    blind = (vectors[:, unseen] / values[unseen]) @ vectors[:, unseen].T
    return (vectors / values) @ vectors.T / np.outer(scale, scale), blind / np.outer(scale, scale)
