"""Symmetric positive semidefinite systems JᵀJ x = b, solved in the directions that the data determine.

JᵀJ has no negative eigenvalue, but a direction in which the data hold no information has an eigenvalue of zero, or
whatever rounding makes of it.  Every function here first scales the matrix to a unit diagonal, so that units (mm,
radians) and the sizes of grains do not matter.  A direction is *unresolved* if its eigenvalue is then below
`RESOLVED_EIGENVALUE`: the solution has no component along it.  No function raises because of rounding, and the last
digits of the arithmetic never decide the length of a step.  A matrix that is not finite raises
``numpy.linalg.LinAlgError``.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from grainmotion._typing import Float

RESOLVED_EIGENVALUE = 1e-10
"""Eigenvalue of the scaled matrix from which a direction is resolved.

Derivatives in single precision have relative errors of about 1e-6, so that a direction without any information shows
an eigenvalue of about 1e-12; one with an eigenvalue of 1e-10 has a standard deviation of 100,000 times the best one."""

UNOBSERVED_DIAGONAL = 1e-20
"""Share of the largest diagonal entry up to which no data depend on an unknown."""


def unit_scale(diagonal: Float, threshold: float = 0.0) -> Float:
    """Factors ``(..., n)`` that scale matrices of a ``diagonal`` to a unit one; 0 for an unobserved unknown.

    ``threshold`` is the share of the largest entry up to which an entry counts as zero.
    """
    largest = np.max(diagonal, axis=-1, initial=0.0, keepdims=True)
    observed = diagonal > np.maximum(threshold * largest, 1e-300)
    return np.where(observed, 1.0 / np.sqrt(np.where(observed, diagonal, 1.0)), 0.0)


def damped_solver(matrix: Float, damping: float = 0.0) -> Callable[[Float], Float]:
    """Solver of (A + λ diag A) x = b for a vector or for columns b.

    Parameters
    ----------
    matrix : (n, n) array
        A, symmetric and positive semidefinite but for rounding.
    damping : float
        λ, at least 0.

    Returns
    -------
    callable
        From b ``(n,)`` or ``(n, k)`` to x of its shape; zero along unresolved directions.
    """
    _check(matrix)
    scale = unit_scale(np.diagonal(matrix), UNOBSERVED_DIAGONAL)
    unit = matrix * np.outer(scale, scale)
    unit[np.diag_indices_from(unit)] = 1.0
    if _positive(unit - RESOLVED_EIGENVALUE * np.eye(len(unit))):
        factor = cho_factor(unit + damping * np.eye(len(unit)), check_finite=False)
        return lambda b: _scaled(scale, cho_solve(factor, _scaled(scale, b), check_finite=False))
    values, vectors = np.linalg.eigh(unit)
    resolved = values > RESOLVED_EIGENVALUE
    basis = vectors[:, resolved] / np.sqrt(values[resolved] + damping)
    return lambda b: _scaled(scale, basis @ (basis.T @ _scaled(scale, b)))


def pseudo_inverse(matrices: Float, like: Float | None = None) -> Float:
    """Inverses ``(..., n, n)`` of one or many matrices in the resolved directions, zero along the others.

    ``like (..., n)`` are diagonals by which to scale instead of the matrices' own: where a matrix is a difference
    (a Schur complement), the minuend's diagonal shows how much of it is rounding.
    """
    _check(matrices)
    scale = unit_scale(np.diagonal(matrices, axis1=-2, axis2=-1) if like is None else like)
    scales = scale[..., :, None] * scale[..., None, :]
    values, vectors = np.linalg.eigh(matrices * scales)
    resolved = values > RESOLVED_EIGENVALUE
    inverses = np.where(resolved, 1.0 / np.where(resolved, values, 1.0), 0.0)
    return np.asarray(scales * ((vectors * inverses[..., None, :]) @ np.swapaxes(vectors, -1, -2)))


def unresolved_information(matrices: Float) -> Float:
    """Information ``(..., n, n)`` that makes each matrix definite when it is added along unresolved directions.

    It is V Vᵀ in the scale of unit diagonals, with V the unresolved eigenvectors, and so gives these directions the
    information that an unknown has in the mean; an unobserved unknown gets 1.
    """
    _check(matrices)
    diagonals = np.diagonal(matrices, axis1=-2, axis2=-1)
    scale = unit_scale(diagonals, UNOBSERVED_DIAGONAL)
    units = matrices * scale[..., :, None] * scale[..., None, :]
    if _positive(units - RESOLVED_EIGENVALUE * np.eye(matrices.shape[-1])):
        return np.zeros_like(matrices)
    values, vectors = np.linalg.eigh(units)
    unresolved = vectors * (values <= RESOLVED_EIGENVALUE)[..., None, :]
    back = np.where(scale > 0, np.sqrt(np.maximum(diagonals, 0.0)), 1.0)
    information = unresolved @ np.swapaxes(unresolved, -1, -2)
    return np.asarray(information * back[..., :, None] * back[..., None, :])


def _check(matrices: Float) -> None:
    if not np.isfinite(matrices).all():
        raise np.linalg.LinAlgError("the matrix is not finite")


def _positive(matrices: Float) -> bool:
    """Whether all matrices are positive definite."""
    try:
        np.linalg.cholesky(matrices)
    except np.linalg.LinAlgError:
        return False
    return True


def _scaled(scale: Float, b: Float) -> Float:
    return (scale * b.T).T
