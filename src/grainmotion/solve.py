"""Damped Gauss–Newton (Levenberg–Marquardt) on block-sparse normal equations; knows no X-rays.

Minimises ½‖r(x)‖² over many unknowns with a sparse matrix and a few that couple with all of them: linear
ones, already eliminated exactly from r (variable projection; Golub and Pereyra 1973, in Kaufman's form), then
ones that step with the others.  One damped step solves

    [H + λ diag H   B] [δ]     [g]
    [     Bᵀ        D] [ε] = − [h],     H = JᵀJ,  B = JᵀC,  D = CᵀC,  g = Jᵀr,  h = Cᵀr,

with h zero for what was eliminated.  H is sparse in blocks; B has few columns, so the Schur complement on
them is small and dense.  The damping follows Nielsen (1999).

Small problems are solved by a dense Cholesky factor.  Large ones have an H that is a product only (`Normal`), and
ε goes out first:  (H + λ diag H − B D⁺ Bᵀ) δ = −g + B D⁺ h  by conjugate gradients, preconditioned by the 6×6 blocks
on the diagonal of H, as far as a Gauss–Newton step is worth (`FORCING`).  Decision 0015 holds the measurements.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Generic, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.linalg import LinAlgError, cho_factor, cho_solve

Array = NDArray[np.float64]
State = TypeVar("State")

DENSE_UP_TO = 600
"""Unknowns up to which a dense Cholesky factor is taken; beyond, conjugate gradients with block Jacobi."""

FORCING, EXACTLY, MOST, ENOUGH = 1e-2, 1e-8, 500, 60
"""Relative residual at which conjugate gradients end: of a step unless told, and of `inverse`; iterations at most, and
of a step, which is a good one long before what is hardly determined is solved for."""

FIRM = 1e-2
"""Damping up to which a small decrease says that the minimum is near, not that the step was held back."""

EMPTY = 1e-20
"""Share of the largest diagonal entry below which an unknown counts as unseen, and stays where it is."""


class Normal(Protocol):
    """JᵀJ as a product, in 6×6 blocks."""

    @property
    def shape(self) -> tuple[int, int]:
        """``(N, N)``."""
        ...

    def diagonal(self) -> Array:
        """``(N,)``."""
        ...

    def blocks(self) -> Array:
        """The blocks on the diagonal, ``(N / 6, 6, 6)``."""
        ...

    def __matmul__(self, x: Array) -> Array:
        """JᵀJ x of a vector ``(N,)``."""
        ...


Hessian = sparse.bsr_array | Array | Normal


@dataclass(frozen=True, eq=False)
class Linearization:
    """The problem at one state.

    Attributes
    ----------
    cost : float
        ½‖r‖² with the linear unknowns at their best.
    gradient : (N,) array
        g = Jᵀr.
    hessian : (N, N) array, sparse matrix or Normal
        JᵀJ, in 6×6 blocks if it is no array.
    border : (N, m) array
        B = JᵀC; m may be 0.
    corner : (m, m) array
        D = CᵀC.
    slope : (k,) array
        h of the last k of those m, which are not eliminated but step with the others; k may be 0.
    """

    cost: float
    gradient: Array
    hessian: Hessian
    border: Array
    corner: Array
    slope: Array = field(default_factory=lambda: np.zeros(0))


class Problem(Protocol[State]):
    """What a residual offers to the solver."""

    def linearize(self, state: State) -> Linearization:
        """Cost, gradient and normal matrix at a state."""
        ...

    def cost(self, state: State) -> float:
        """The cost alone, which is cheaper."""
        ...

    def retract(self, state: State, step: Array) -> State:
        """The state after a step ``(N + k,)``."""
        ...

    def sizes(self, state: State, step: Array) -> Array:
        """How far a step moves each of the things that move, in the unit of the tolerance."""
        ...


@dataclass(frozen=True)
class Stopping:
    """When to stop: a step smaller than ``step``, a relative decrease below ``decrease``, or ``iterations``.

    A decrease that is only expected counts as well: such a last step is taken without a linearisation at its end.
    A decrease ends nothing while more than a share ``stragglers`` of all things that move go further than ``reach``.
    ``forcing`` is the relative residual to which steps of large problems are solved.
    """

    iterations: int = 30
    step: float = 1e-3
    decrease: float = 1e-7
    reach: float = np.inf
    stragglers: float = 0.0
    forcing: float = FORCING


@dataclass(frozen=True, eq=False)
class Solution(Generic[State]):
    """Where the solver ended: the state, the costs and whether it settled."""

    state: State
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
        cost any more; False when the iterations ran out, or stragglers were left behind.
    """
    stopping = stopping or Stopping()
    state, here = start, problem.linearize(start)
    costs = [here.cost]
    damping, growth = 1e-4, 2.0
    step = np.zeros(len(here.gradient) + len(here.slope))
    ended = settled = False
    while len(costs) <= stopping.iterations and not ended:
        proposal = damped_step(here, damping, stopping.forcing)
        trial_state = problem.retract(state, proposal)
        sizes, predicted = problem.sizes(state, proposal), predicted_decrease(here, proposal, damping)
        far = float((sizes > stopping.reach).mean())
        small = stopping.decrease * here.cost if damping <= FIRM and far <= stopping.stragglers else 0.0
        last = sizes.max() < stopping.step or predicted < small
        there = None if last else problem.linearize(trial_state)
        cost = problem.cost(trial_state) if there is None else there.cost
        if cost < here.cost:
            ratio = (here.cost - cost) / predicted if predicted > 0 else 0.0
            ended = last or here.cost - cost < small
            settled = ended and far == 0
            damping *= max(0.1, 1 - (2 * min(ratio, 1.5) - 1) ** 3)
            damping, growth = max(damping, 1e-9), 2.0
            state, step = trial_state, proposal
            here = here if there is None else there
            costs.append(cost)
            if observe is not None:
                observe(cost)
        else:
            ended = settled = last or damping > 1e6
            damping, growth = max(damping, 1e-4) * growth, growth * 2
    return Solution(state, tuple(costs), step, settled)


def damped_step(at: Linearization, damping: float, forcing: float = FORCING) -> Array:
    """The step (δ, ε) ``(N + k,)``, ε of what is not eliminated alone."""
    if not _small(at.hessian):
        return _iterated_step(at, damping, forcing)
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


def _small(hessian: Hessian) -> bool:
    return hessian.shape[0] <= DENSE_UP_TO


def eliminated(at: Linearization, damping: float) -> tuple[Callable[[Array], Array], Array, Array]:
    """x ↦ (H + λ diag H − B D⁺ Bᵀ) x, D⁺, and the blocks on the diagonal of H + λ diag H."""
    few = np.linalg.pinv(at.corner, hermitian=True).astype(float) if len(at.corner) else np.zeros((0, 0))
    matrix, lifted, blocks = _lifted(at.hessian, damping)

    def product(x: Array) -> Array:  # of a vector, or of columns
        return matrix @ x + (lifted * x.T).T - at.border @ (few @ (at.border.T @ x))

    return product, few, blocks


def _iterated_step(at: Linearization, damping: float, forcing: float) -> Array:
    """The same by conjugate gradients on what is left of H once ε is eliminated."""
    slope = np.zeros(len(at.corner))
    slope[len(slope) - len(at.slope) :] = at.slope
    product, few, blocks = eliminated(at, damping)
    most = ENOUGH if forcing >= FORCING else MOST
    own = conjugate_gradients(product, blocks, at.border @ (few @ slope) - at.gradient, forcing, most)
    rest = -few @ (slope + at.border.T @ own)
    return np.concatenate([own, rest[len(rest) - len(at.slope) :]])


def inverse(hessian: Hessian, damping: float) -> Callable[[Array], Array]:
    """Solver of (H + λ diag H) x = b for vectors or columns b; empty rows are kept at zero."""
    matrix, lifted, blocks = _lifted(hessian, damping)
    if _small(hessian):
        dense = matrix.toarray() if sparse.issparse(matrix) else np.array(matrix)
        dense[np.diag_indices_from(dense)] += lifted
        for lift in (0.0, 1e-9, 1e-6, 1e-3):
            try:
                factor = cho_factor(dense + lift * np.diag(np.diagonal(dense)), check_finite=False)
            except LinAlgError:
                continue
            return lambda b: cho_solve(factor, b, check_finite=False)
        raise LinAlgError("normal matrix is not positive even when damped")

    def solve(b: Array) -> Array:
        return conjugate_gradients(lambda x: matrix @ x + (lifted * x.T).T, blocks, b, EXACTLY)

    return solve


def conjugate_gradients(
    product: Callable[[Array], Array], blocks: Array, b: Array, accuracy: float, most: int = MOST
) -> Array:
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
        length = now / (ahead * across).sum(axis=0)
        found[:, still] += length * ahead
        rest[:, still] -= length * across
        along[:, still], before[still] = ahead, now
    return found.reshape(b.shape)


def _lifted(hessian: Hessian, damping: float) -> tuple[Hessian, Array, Array]:
    """H fit for products, what is added to its diagonal, and the blocks on the diagonal of both, if H is large."""
    diagonal = np.asarray(hessian.diagonal())
    filled = diagonal > EMPTY * max(float(diagonal.max(initial=0.0)), 1e-300)
    lifted = damping * diagonal + np.where(filled, 1e-12 * diagonal, 1.0)
    if _small(hessian):
        return hessian, lifted, np.zeros((0, 6, 6))
    if isinstance(hessian, np.ndarray):
        hessian = sparse.bsr_array(hessian, blocksize=(6, 6))
    blocks = diagonal_blocks(hessian).copy()
    blocks[:, range(6), range(6)] += lifted.reshape(-1, 6)
    return hessian, lifted, blocks


def diagonal_blocks(matrix: Hessian) -> Array:
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


def predicted_decrease(at: Linearization, step: Array, damping: float) -> float:
    """Decrease that the quadratic model promises for a ``step`` of `damped_step`."""
    own = step[: len(at.gradient)]
    slopes = float(at.gradient @ own) + float(at.slope @ step[len(own) :])
    return 0.5 * (damping * float(own @ (np.asarray(at.hessian.diagonal()) * own)) - slopes)
