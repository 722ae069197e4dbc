"""Symmetric systems in 6×6 blocks: dense Cholesky if small, else conjugate gradients with block Jacobi."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

import numpy as np
from scipy import sparse

from grainmotion._typing import Float
from grainmotion.solvers.semidefinite import solver, unresolved

DENSE_UP_TO = 600
"""Unknowns up to which a dense Cholesky factor is taken; beyond, conjugate gradients with block Jacobi."""

INVERSE_TOLERANCE, MAX_ITERATIONS = 1e-8, 500
"""Relative residual at which the conjugate gradients of `inverse` end; iterations at most."""


class Normal(Protocol):
    """JᵀJ as a product, in 6×6 blocks."""

    @property
    def shape(self) -> tuple[int, int]:
        """``(N, N)``."""
        ...

    def diagonal(self) -> Float:
        """``(N,)``."""
        ...

    def blocks(self) -> Float:
        """The blocks on the diagonal, ``(N / 6, 6, 6)``."""
        ...

    def __matmul__(self, x: Float) -> Float:
        """JᵀJ x of a vector ``(N,)``."""
        ...


Hessian = sparse.bsr_array | Float | Normal


def is_small(hessian: Hessian) -> bool:
    return hessian.shape[0] <= DENSE_UP_TO


def inverse(hessian: Hessian, damping: float) -> Callable[[Float], Float]:
    """Solver of (H + λ diag H) x = b for vectors or columns b; what the data do not resolve is held.

    That is told from the whole matrix if it is small, else from each grain's own block.
    """
    if is_small(hessian):
        return solver(hessian.toarray() if isinstance(hessian, sparse.bsr_array) else np.asarray(hessian), damping)
    product, blocks = damped_product(hessian, damping)
    return lambda b: conjugate_gradients(product, blocks, b, INVERSE_TOLERANCE)


def conjugate_gradients(
    product: Callable[[Float], Float], blocks: Float, b: Float, accuracy: float, most: int = MAX_ITERATIONS
) -> Float:
    """Solve A x = b for a vector or for columns ``(N, k)`` to a relative residual, preconditioned by 6×6 blocks.

    Columns go side by side, each until it is solved: one product with many costs less than as many products.
    """
    inverses, rest = np.linalg.inv(blocks), b.reshape(len(b), -1).astype(float)
    found, along, before = np.zeros_like(rest), np.zeros_like(rest), np.ones(rest.shape[1])
    enough = accuracy * np.linalg.norm(rest, axis=0)
    for step in range(most):
        still = np.flatnonzero(np.linalg.norm(rest, axis=0) > enough)
        if not len(still):
            break
        near = np.einsum("nij,njk->nik", inverses, rest[:, still].reshape(-1, 6, len(still))).reshape(-1, len(still))
        now = (rest[:, still] * near).sum(axis=0)
        ahead = near + along[:, still] * (now / before[still] if step else 0.0)
        across = product(ahead)
        curvature = (ahead * across).sum(axis=0)
        length = np.divide(now, curvature, out=np.zeros_like(now), where=curvature > 0)
        found[:, still] += length * ahead
        rest[:, still] -= length * across
        along[:, still], before[still] = ahead, now
    return found.reshape(b.shape)


def damped_product(hessian: Hessian, damping: float) -> tuple[Callable[[Float], Float], Float]:
    """x ↦ (H + λ diag H) x for vectors or columns, unresolved directions held, and its blocks on the diagonal."""
    matrix = sparse.bsr_array(hessian, blocksize=(6, 6)) if isinstance(hessian, np.ndarray) else hessian
    blocks = diagonal_blocks(matrix)
    added = unresolved(blocks)
    added[:, range(6), range(6)] += damping * np.diagonal(blocks, axis1=1, axis2=2)

    def product(x: Float) -> Float:
        lift = added @ x.reshape(len(added), 6, -1)
        return matrix @ x + lift.reshape(x.shape)

    return product, blocks + added


def diagonal_blocks(matrix: Hessian) -> Float:
    """The 6×6 blocks on the diagonal, ``(n, 6, 6)``; zero where there is none."""
    if isinstance(matrix, np.ndarray):
        matrix = sparse.bsr_array(matrix, blocksize=(6, 6))
    if not isinstance(matrix, sparse.bsr_array):
        return matrix.blocks()
    n = matrix.shape[0] // 6
    rows = np.repeat(np.arange(n), np.diff(matrix.indptr))
    on = rows == matrix.indices
    blocks = np.zeros((n, 6, 6))
    blocks[rows[on]] = matrix.data[on]
    return blocks
