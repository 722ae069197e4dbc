"""Covariances of all motions, from the noise and the model error that the residuals show.

The estimate solves the normal equations A x = (F w J)ᵀ F w r, with all else that was estimated eliminated from
A, so its covariance is A⁻¹ M A⁻¹ with M that of the right-hand side: the variances of the pixels, carried
through weights w and filter F.  They are those of `weighting.NoiseModel`: photons, an even model error and one of
edges, all estimated from the residuals.  A grain whose own residuals exceed these variances has its covariance
raised (`excess`).
"""

from __future__ import annotations

from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from grainmotion.kernels import normal
from grainmotion.packed import Pose
from grainmotion.solve import DENSE_UP_TO, inverse
from grainmotion.tracking.cast import own_sums
from grainmotion.tracking.columns import Columns
from grainmotion.tracking.residual import Seen, StateProblem, Target, gaussian
from grainmotion.tracking.weighting import noise_model, open_beam

Float = NDArray[np.float64]
LEAST_SHARE = 2e-3
"""Of the radiographs' rms: no residual is trusted to be smaller; no radiograph and no voxel image is better."""
OUTLYING = 4.0
"""Standard deviations to which residuals are cut when the model error is estimated."""
STRUCTURE = 2.0
"""Pixels: width of the filter that tells structure from noise in what is left unexplained."""
ROUNDING = 1e-6
"""Of the normal matrices, which are summed from single precision."""


def covariances(problem: StateProblem, pose: Pose, seen: Seen, hessian: sparse.bsr_array) -> tuple[Float, Float]:
    """Covariances ``(n, 6, 6)`` of (u, δ), mm and radians, and ``(k, k)`` of the surroundings' unknowns."""
    n, columns = len(problem.grains), seen.linear + seen.loose
    border, corner = seen.cast.border(columns), columns.gram()
    free = len(seen.loose.owners)
    if free:
        corner[-free:, -free:] += problem.surrounding_prior(pose)[0]
    variances = pixel_variances(problem.target, seen)
    own, both, few = carried(problem.target, seen, columns, variances)
    eliminate = np.linalg.pinv(corner, hermitian=True) @ border.T if len(corner) else np.zeros((0, 6 * n))
    spread = float(np.mean(variances))
    out = np.empty((n, 6, 6))
    for rows, wanted in neighbourhoods(hessian):
        across = eliminate[:, rows]
        mixed = both[rows] @ across
        meat = square(own, rows) - mixed - mixed.T + across.T @ few @ across
        bread, unseen = regular_inverse(square(hessian, rows) - border[rows] @ across)
        full = bread @ meat @ bread + spread * unseen
        for k, grain in enumerate(wanted):
            out[grain] = full[6 * k : 6 * k + 6, 6 * k : 6 * k + 6]
    out *= excess(problem, seen, variances)[:, None, None]
    if not free:
        return out, np.zeros((0, 0))
    across = inverse(hessian, 0.0)(border)
    left, _ = regular_inverse(corner - border.T @ across)
    mixed = both.T @ across
    full = left @ (few - mixed - mixed.T + across.T @ (own @ across)) @ left
    return out, full[-free:, -free:]


def pixel_variances(target: Target, seen: Seen) -> Float:
    """Variance of every pixel of the radiographs, line integrals squared."""
    noise = noise_model(target, seen, OUTLYING)  # a grain that does not fit says nothing of the others
    least = LEAST_SHARE**2 * float(np.mean(target.scan.line_integrals.astype(float) ** 2))
    return noise.variance(seen.response.apply(seen.path), open_beam(target)) + least


def carried(target: Target, seen: Seen, columns: Columns, variances: Float) -> tuple[sparse.bsr_array, Float, Float]:
    """Covariances of the right-hand sides: of grains ``(6n, 6n)``, of these with columns, of columns ``(m, m)``."""
    factor = (target.roots * np.sqrt(variances)).astype(target.precision)
    stacks = Columns(shared=columns.shared)
    for stack in columns.stacks:
        twice = stack.copy()
        normal.filter_images(twice, target.kernel)
        stacks.stacks.append(factor * twice)
    again = seen.cast.refiltered(factor, target.kernel)
    return again.normal_matrix(), again.border(stacks), stacks.gram()


def excess(problem: StateProblem, seen: Seen, variances: Float) -> Float:
    """Factor on each grain's covariance for residuals beyond the variances of its pixels, at least 1, ``(n,)``.

    What is beyond them is no noise but a broken neighbour, hardening, or the like, and correlated over as many
    pixels as a Gaussian filter leaves it standing, against what it leaves of noise.
    """
    valid = problem.target.valid
    smooth = seen.raw.copy()
    kernel = gaussian(STRUCTURE).astype(smooth.dtype)
    normal.filter_images(smooth, kernel)
    left_of_noise = float((np.concatenate([kernel[:0:-1], kernel]).astype(float) ** 2).sum()) ** 2
    sums = seen.cast.each(partial(own_sums, terms=_weighted_sums, count=3), seen.raw, smooth, variances, valid)
    squares, smoothed, expected = np.maximum(sums.T, 1e-300)
    correlated = np.maximum(1.0, smoothed / (left_of_noise * squares))
    return 1.0 + np.maximum(0.0, squares / expected - 1.0) * correlated


def _weighted_sums(own: Float, raw: Float, smooth: Float, variances: Float, valid: Float) -> list[float]:
    weight = np.abs(own) * valid
    return [float(weight @ raw**2), float(weight @ smooth**2), float(weight @ variances)]


def neighbourhoods(hessian: sparse.bsr_array) -> list[tuple[NDArray[np.int64], NDArray[np.int64]]]:
    """Rows of grains that are treated together, and the grains, first among them, that are wanted of each."""
    n = hessian.shape[0] // 6
    unknowns = np.arange(6)
    if 6 * n <= DENSE_UP_TO:
        return [(np.arange(6 * n), np.arange(n))]
    found = []
    for i in range(n):
        near = hessian.indices[hessian.indptr[i] : hessian.indptr[i + 1]]
        near = np.r_[i, np.setdiff1d(near, i)]
        found.append(((6 * near[:, None] + unknowns).ravel(), np.array([i])))
    return found


def square(matrix: sparse.bsr_array, rows: NDArray[np.int64]) -> Float:
    """The part of a sparse matrix that some rows and the same columns hold, dense."""
    return sparse.csr_array(matrix)[rows][:, rows].toarray()


def regular_inverse(matrix: Float) -> tuple[Float, Float]:
    """Inverse after scaling to unit diagonal, and what of it belongs to unseen directions: huge, not an error."""
    scale = np.sqrt(np.maximum(np.diagonal(matrix), 1e-30))
    values, vectors = np.linalg.eigh(matrix / np.outer(scale, scale))
    unseen = values < ROUNDING
    values = np.maximum(values, ROUNDING)
    blind = (vectors[:, unseen] / values[unseen]) @ vectors[:, unseen].T
    return (vectors / values) @ vectors.T / np.outer(scale, scale), blind / np.outer(scale, scale)
