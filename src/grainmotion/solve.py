"""Damped Gauss–Newton (Levenberg–Marquardt) on block-sparse normal equations; knows no X-rays.

Minimises ½‖r(x)‖² over many unknowns with a sparse matrix and a few that couple with all of them: linear
ones, already eliminated exactly from r (variable projection; Golub and Pereyra 1973, in Kaufman's form), then
ones that step with the others.  One damped step solves

    [H + λ diag H   B] [δ]     [g]
    [     Bᵀ        D] [ε] = − [h],     H = JᵀJ,  B = JᵀC,  D = CᵀC,  g = Jᵀr,  h = Cᵀr,

with h zero for what was eliminated.  H is sparse in blocks; B has few columns, so the Schur complement on
them is small and dense.  The damping follows Nielsen (1999).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Generic, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.linalg import LinAlgError, cho_factor, cho_solve
from scipy.sparse.linalg import LinearOperator, cg

Array = NDArray[np.float64]
State = TypeVar("State")

DENSE_UP_TO = 3000
"""Unknowns up to which a dense Cholesky factor is taken; beyond, conjugate gradients with block Jacobi."""

EMPTY = 1e-20
"""Share of the largest diagonal entry below which an unknown counts as unseen, and stays where it is."""


@dataclass(frozen=True, eq=False)
class Linearization:
    """The problem at one state.

    Attributes
    ----------
    cost : float
        ½‖r‖² with the linear unknowns at their best.
    gradient : (N,) array
        g = Jᵀr.
    hessian : (N, N) sparse matrix or array
        JᵀJ, in 6×6 blocks if sparse.
    border : (N, m) array
        B = JᵀC; m may be 0.
    corner : (m, m) array
        D = CᵀC.
    slope : (k,) array
        h of the last k of those m, which are not eliminated but step with the others; k may be 0.
    """

    cost: float
    gradient: Array
    hessian: sparse.bsr_array | Array
    border: Array
    corner: Array
    slope: Array = field(default_factory=lambda: np.zeros(0))


class Problem(Protocol[State]):
    """What a residual offers to the solver."""

    def linearize(self, state: State) -> Linearization:
        """Cost, gradient and normal matrix at a state."""
        ...

    def retract(self, state: State, step: Array) -> State:
        """The state after a step ``(N + k,)``."""
        ...

    def size(self, state: State, step: Array) -> float:
        """How large a step is, in the unit of the tolerance."""
        ...


@dataclass(frozen=True)
class Stopping:
    """When to stop: a step smaller than ``step``, a relative decrease below ``decrease``, or ``iterations``."""

    iterations: int = 30
    step: float = 1e-3
    decrease: float = 1e-7


@dataclass(frozen=True, eq=False)
class Solution(Generic[State]):
    """Where the solver ended: the state, its linearisation, the costs and whether it settled."""

    state: State
    linearization: Linearization
    costs: tuple[float, ...]
    last_step: Array
    settled: bool = field(default=False)

    @property
    def iterations(self) -> int:
        """Accepted steps."""
        return len(self.costs) - 1


def gauss_newton(
    problem: Problem[State],
    start: State,
    stopping: Stopping | None = None,
    observe: Callable[[float], None] | None = None,
) -> Solution[State]:
    """Minimise from ``start``; ``observe(cost)`` is called after each accepted step.

    Returns
    -------
    Solution
        ``settled`` is True when a step or the decrease fell below its tolerance, or no step lowers the
        cost any more; False when the iterations ran out.
    """
    stopping = stopping or Stopping()
    state, here = start, problem.linearize(start)
    costs = [here.cost]
    damping, growth = 1e-4, 2.0
    step = np.zeros(len(here.gradient) + len(here.slope))
    settled = False
    while len(costs) <= stopping.iterations and not settled:
        proposal = damped_step(here, damping)
        trial_state = problem.retract(state, proposal)
        there = problem.linearize(trial_state)
        size = problem.size(state, proposal)
        if there.cost < here.cost:
            predicted = _predicted(here, proposal, damping)
            ratio = (here.cost - there.cost) / predicted if predicted > 0 else 0.0
            settled = size < stopping.step or here.cost - there.cost < stopping.decrease * here.cost
            damping *= max(0.1, 1 - (2 * min(ratio, 1.5) - 1) ** 3)
            damping, growth = max(damping, 1e-9), 2.0
            state, here, step = trial_state, there, proposal
            costs.append(here.cost)
            if observe is not None:
                observe(here.cost)
        else:
            settled = size < stopping.step or damping > 1e6
            damping, growth = max(damping, 1e-4) * growth, growth * 2
    return Solution(state, here, tuple(costs), step, settled)


def damped_step(at: Linearization, damping: float) -> Array:
    """The step (δ, ε) ``(N + k,)``, ε of what is not eliminated alone."""
    solve = inverse(at.hessian, damping)
    plain = solve(at.gradient)
    if at.border.shape[1] == 0:
        return -plain
    across = solve(at.border)
    small = at.corner - at.border.T @ across
    slope = np.zeros(len(small))
    slope[len(small) - len(at.slope) :] = at.slope
    few = np.linalg.lstsq(small, at.border.T @ plain - slope, rcond=None)[0]
    return np.concatenate([-(plain + across @ few), few[len(few) - len(at.slope) :]])


def inverse(hessian: sparse.bsr_array | Array, damping: float) -> Callable[[Array], Array]:
    """Solver of (H + λ diag H) x = b for vectors or columns b; empty rows are kept at zero."""
    diagonal = np.asarray(hessian.diagonal())
    filled = diagonal > EMPTY * max(float(diagonal.max(initial=0.0)), 1e-300)
    lifted = damping * diagonal + np.where(filled, 1e-12 * diagonal, 1.0)
    if hessian.shape[0] <= DENSE_UP_TO:
        dense = hessian.toarray() if sparse.issparse(hessian) else np.array(hessian)
        dense[np.diag_indices_from(dense)] += lifted
        for lift in (0.0, 1e-9, 1e-6, 1e-3):
            try:
                factor = cho_factor(dense + lift * np.diag(np.diagonal(dense)), check_finite=False)
            except LinAlgError:
                continue
            return lambda b: cho_solve(factor, b, check_finite=False)
        raise LinAlgError("normal matrix is not positive even when damped")
    hessian = sparse.bsr_array(hessian, blocksize=(6, 6))
    matrix = sparse.csr_array(hessian) + sparse.diags_array(lifted)
    jacobi = _block_jacobi(hessian, lifted)

    def solve(b: Array) -> Array:
        columns = b.reshape(len(b), -1)
        found = [cg(matrix, c, rtol=1e-8, maxiter=500, M=jacobi)[0] for c in columns.T]
        return np.stack(found, axis=1).reshape(b.shape)

    return solve


def _block_jacobi(hessian: sparse.bsr_array, lifted: Array) -> LinearOperator:
    n = hessian.shape[0] // 6
    rows = np.repeat(np.arange(n), np.diff(hessian.indptr))
    on = rows == hessian.indices
    blocks = np.zeros((n, 6, 6))
    blocks[rows[on]] = hessian.data[on]
    blocks[:, range(6), range(6)] += lifted.reshape(n, 6)
    inverses = np.linalg.inv(blocks)
    return LinearOperator(
        hessian.shape,
        matvec=lambda b: np.einsum("nij,nj->ni", inverses, b.reshape(n, 6)).ravel(),
        dtype=float,
    )


def _predicted(at: Linearization, step: Array, damping: float) -> float:
    """Decrease that the quadratic model promises for a ``step`` of `damped_step`."""
    own = step[: len(at.gradient)]
    slopes = float(at.gradient @ own) + float(at.slope @ step[len(own) :])
    return 0.5 * (damping * float(own @ (np.asarray(at.hessian.diagonal()) * own)) - slopes)
