"""Symmetric systems JᵀJ x = b, solved in the directions that the data resolve.

JᵀJ has no negative eigenvalue, but a direction in which the data tell nothing has one that is zero, or what rounding
makes of it.  Everything here first scales the matrix to a unit diagonal, so that units (mm, radians) and the sizes
of grains do not matter.  A direction whose eigenvalue is then below `RESOLVED` is *held*: the solution has no
component along it.  No function raises because of rounding, and none lets the last digits decide how long a step is.
A matrix that is not finite is no matter of rounding, and raises ``numpy.linalg.LinAlgError``.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from grainmotion._typing import Float

RESOLVED = 1e-10
"""Eigenvalue of the scaled matrix from which a direction is resolved.

Derivatives in single precision have relative errors of about 1e-6, so that a direction without any information shows
an eigenvalue of about 1e-12; one with an eigenvalue of 1e-10 has a standard deviation of 100,000 times the best one."""

EMPTY = 1e-20
"""Share of the largest diagonal entry up to which an unknown of a step counts as unseen: no data depend on it."""


def unit_scale(diagonal: Float, empty: float = 0.0) -> Float:
    """Factors ``(..., n)`` that scale matrices of a ``diagonal`` to a unit one; 0 for an unknown that nothing sees.

    ``empty`` is the share of the largest entry up to which one counts as zero.
    """
    largest = np.max(diagonal, axis=-1, initial=0.0, keepdims=True)
    seen = diagonal > np.maximum(empty * largest, 1e-300)
    return np.where(seen, 1.0 / np.sqrt(np.where(seen, diagonal, 1.0)), 0.0)


def solver(matrix: Float, damping: float = 0.0) -> Callable[[Float], Float]:
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
        From b ``(n,)`` or ``(n, k)`` to x of its shape; zero along the directions that are held.
    """
    _check(matrix)
    scale = unit_scale(np.diagonal(matrix), EMPTY)
    unit = matrix * np.outer(scale, scale)
    unit[np.diag_indices_from(unit)] = 1.0
    if _positive(unit - RESOLVED * np.eye(len(unit))):
        factor = cho_factor(unit + damping * np.eye(len(unit)), check_finite=False)
        return lambda b: _scaled(scale, cho_solve(factor, _scaled(scale, b), check_finite=False))
    values, vectors = np.linalg.eigh(unit)
    kept = vectors[:, values > RESOLVED] / np.sqrt(values[values > RESOLVED] + damping)
    return lambda b: _scaled(scale, kept @ (kept.T @ _scaled(scale, b)))


def pseudo_inverse(matrices: Float, like: Float | None = None) -> Float:
    """Inverses ``(..., n, n)`` of one or many matrices in the directions that are resolved, zero along the others.

    ``like (..., n)`` are diagonals by which to scale instead of the matrices' own: where a matrix is a difference
    (a Schur complement), those of the minuend tell how much of it is rounding.
    """
    _check(matrices)
    scale = unit_scale(np.diagonal(matrices, axis1=-2, axis2=-1) if like is None else like)
    both = scale[..., :, None] * scale[..., None, :]
    values, vectors = np.linalg.eigh(matrices * both)
    inverses = np.where(values > RESOLVED, 1.0 / np.where(values > RESOLVED, values, 1.0), 0.0)
    found: Float = both * ((vectors * inverses[..., None, :]) @ np.swapaxes(vectors, -1, -2))
    return found


def unresolved(matrices: Float) -> Float:
    """What holds the unresolved directions of each matrix if it is added to it, ``(..., n, n)``.

    It is V Vᵀ in the scale of unit diagonals, and so gives these directions the information that an unknown has in
    the mean; an unknown that nothing sees gets 1.
    """
    _check(matrices)
    diagonals = np.diagonal(matrices, axis1=-2, axis2=-1)
    scale = unit_scale(diagonals, EMPTY)
    units = matrices * scale[..., :, None] * scale[..., None, :]
    if _positive(units - RESOLVED * np.eye(matrices.shape[-1])):
        return np.zeros_like(matrices)
    values, vectors = np.linalg.eigh(units)
    held = vectors * (values <= RESOLVED)[..., None, :]
    back = np.where(scale > 0, np.sqrt(np.maximum(diagonals, 0.0)), 1.0)
    found: Float = (held @ np.swapaxes(held, -1, -2)) * back[..., :, None] * back[..., None, :]
    return found


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
