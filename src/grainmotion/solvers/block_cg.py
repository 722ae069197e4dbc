"""Symmetric systems in 6×6 blocks: dense Cholesky if small, else conjugate gradients with block Jacobi."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

import numpy as np
from scipy import sparse

from grainmotion._typing import Float
from grainmotion.solvers.semidefinite import damped_solver, unresolved_information

MAX_DENSE_UNKNOWNS = 600
"""Unknowns up to which a dense Cholesky factor is taken; beyond, preconditioned conjugate gradients."""

ITERATIONS_COMPARED = 5
"""Iterations whose decrease together tells whether more of them are worth while."""
LEAST_SHARE_OF_DECREASE, TIMES_ENOUGH = 0.05, 20.0
"""Share of the decrease so far that they must reach while it exceeds so many times what is enough: the quadratic model
of a long step is not worth solving."""
CG_INVERSE_TOLERANCE, MAX_CG_ITERATIONS = 1e-8, 500
"""Relative residual at which the conjugate gradients of `inverse` end; iterations at most."""


class NormalMatrix(Protocol):
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


Hessian = sparse.bsr_array | Float | NormalMatrix


def is_small(hessian: Hessian) -> bool:
    """Whether a dense factor is taken."""
    return hessian.shape[0] <= MAX_DENSE_UNKNOWNS


def inverse(hessian: Hessian, damping: float) -> Callable[[Float], Float]:
    """Solver of (H + λ diag H) x = b for vectors or columns b, with x zero along unresolved directions.

    These are found from the whole matrix if it is small, else from each grain's own block.
    """
    if is_small(hessian):
        dense = hessian.toarray() if isinstance(hessian, sparse.bsr_array) else np.asarray(hessian)
        return damped_solver(dense, damping)
    product, blocks = damped_product(hessian, damping)
    return lambda b: conjugate_gradients(product, blocks, b, CG_INVERSE_TOLERANCE)


def conjugate_gradients(
    product: Callable[[Float], Float],
    blocks: Float,
    b: Float,
    tolerance: float,
    max_iterations: int = MAX_CG_ITERATIONS,
    enough: float = 0.0,
) -> Float:
    """Solve A x = b for a vector or for columns ``(N, k)`` to a relative residual, preconditioned by 6×6 blocks.

    Columns are solved side by side, each until it has converged: one product with many columns costs less than as
    many products.  All end once `ITERATIONS_COMPARED` iterations lower ½ xᵀAx − bᵀx by less than ``enough``, or by
    little of its decrease so far.
    """
    gains = list[float]()
    inverses, residual = np.linalg.inv(blocks), b.reshape(len(b), -1).astype(float)
    x, direction, previous = np.zeros_like(residual), np.zeros_like(residual), np.ones(residual.shape[1])
    target = tolerance * np.linalg.norm(residual, axis=0)
    for step in range(max_iterations):
        active = np.flatnonzero(np.linalg.norm(residual, axis=0) > target)
        if not len(active):
            break
        split = residual[:, active].reshape(-1, 6, len(active))
        preconditioned = np.einsum("nij,njk->nik", inverses, split).reshape(-1, len(active))
        rho = (residual[:, active] * preconditioned).sum(axis=0)
        search = preconditioned + direction[:, active] * (rho / previous[active] if step else 0.0)
        image = product(search)
        curvature = (search * image).sum(axis=0)
        length = np.divide(rho, curvature, out=np.zeros_like(rho), where=curvature > 0)
        x[:, active] += length * search
        residual[:, active] -= length * image
        direction[:, active], previous[active] = search, rho
        gains.append(0.5 * float(length @ rho))
        if enough > 0 and not worth_while(gains, enough):
            break
    return x.reshape(b.shape)


def worth_while(gains: list[float], enough: float) -> bool:
    """Whether the last of the decreases by each iteration ask for more iterations."""
    if len(gains) < ITERATIONS_COMPARED:
        return True
    total = sum(gains)
    share = LEAST_SHARE_OF_DECREASE * total if total > TIMES_ENOUGH * enough else 0.0
    return sum(gains[-ITERATIONS_COMPARED:]) > max(enough, share)


def damped_product(hessian: Hessian, damping: float) -> tuple[Callable[[Float], Float], Float]:
    """The product x ↦ (H + λ diag H) x for vectors or columns, and its 6×6 blocks on the diagonal.

    Both are made definite along the unresolved directions of each block.
    """
    matrix = sparse.bsr_array(hessian, blocksize=(6, 6)) if isinstance(hessian, np.ndarray) else hessian
    blocks = diagonal_blocks(matrix)
    added = unresolved_information(blocks)
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
    on_diagonal = rows == matrix.indices
    blocks = np.zeros((n, 6, 6))
    blocks[rows[on_diagonal]] = matrix.data[on_diagonal]
    return blocks
