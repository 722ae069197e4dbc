"""Damped Gauss–Newton (Levenberg–Marquardt) on block-sparse normal equations; knows no X-rays.

Minimises ½‖r(x)‖² over many unknowns with a sparse matrix and a few that couple with all of them: linear
ones, already eliminated exactly from r (variable projection; Golub and Pereyra 1973, in Kaufman's form), then
ones that step with the others.  One damped step solves

    [H + λ diag H   B] [δ]     [g]
    [     Bᵀ        D] [ε] = − [h],     H = JᵀJ,  B = JᵀC,  D = CᵀC,  g = Jᵀr,  h = Cᵀr,

with h zero for what was eliminated, and λ diag D added to D for what was not, so that damping shortens every step.
H is sparse in blocks; B has few columns, so the Schur complement on them is small and dense.  The damping follows
Nielsen (1999).

Small problems are solved by a dense Cholesky factor.  Large ones have an H that is a product only (`Normal`), and
ε goes out first:  (H + λ diag H − B D⁺ Bᵀ) δ = −g + B D⁺ h  by conjugate gradients, preconditioned by the 6×6 blocks
on the diagonal of H, as far as a Gauss–Newton step is worth (`FORCING`).  Decision 0015 holds the measurements.

Directions that the data do not resolve are held (`semidefinite`), and a cost is compared only as far as its digits
are significant (`SIGNIFICANT`), so that no result hangs on how a processor rounds.  Decision 0016 says why.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Generic, Protocol, TypeVar

import numpy as np

from grainmotion._typing import Float
from grainmotion.solvers.block_cg import (
    MAX_ITERATIONS,
    Hessian,
    conjugate_gradients,
    damped_product,
    inverse,
    is_small,
)
from grainmotion.solvers.semidefinite import pseudo_inverse

State = TypeVar("State")

FORCING, MAX_STEP_ITERATIONS = 1e-2, 60
"""Relative residual at which the conjugate gradients of a step end by default, and their iterations at most: a step is
a good one long before what is hardly determined is solved for."""

FIRM = 1e-2
"""Damping up to which a small decrease says that the minimum is near, not that the step was held back."""

TRUSTED = 0.25
"""A small decrease ends the iteration only if it is at least this share of what the quadratic model promised."""

SLOWEST = 0.9
"""Largest ratio of a step to the one before that is extrapolated: beyond it, steps hardly shrink."""

SIGNIFICANT = 1e-6
"""Relative change of the cost that means something: residuals in single precision give it to some 1e-7."""


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
    gradient: Float
    hessian: Hessian
    border: Float
    corner: Float
    slope: Float = field(default_factory=lambda: np.zeros(0))


class Problem(Protocol[State]):
    """What a residual offers to the solver."""

    def linearize(self, state: State) -> Linearization:
        """Cost, gradient and normal matrix at a state."""
        ...

    def cost(self, state: State) -> float:
        """The cost alone, which is cheaper."""
        ...

    def retract(self, state: State, step: Float) -> State:
        """The state after a step ``(N + k,)``."""
        ...

    def sizes(self, state: State, step: Float) -> Float:
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
    last_step: Float
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
    before = np.inf, np.inf  # size and promised decrease of the step before
    ended = settled = False
    while len(costs) <= stopping.iterations and not ended:
        proposal = damped_step(here, damping, stopping.forcing)
        trial_state = problem.retract(state, proposal)
        sizes, predicted = problem.sizes(state, proposal), predicted_decrease(here, proposal, damping)
        far = float((sizes > stopping.reach).mean())
        small = stopping.decrease * here.cost if damping <= FIRM and far <= stopping.stragglers else 0.0
        left = _to_come(sizes.max(), before[0]), _to_come(predicted, before[1])
        last = left[0] < stopping.step or left[1] < small
        there = None if last else problem.linearize(trial_state)
        cost = problem.cost(trial_state) if there is None else there.cost
        as_good = last and predicted > 0 and damping <= FIRM and cost <= (1 + SIGNIFICANT) * here.cost
        if cost < here.cost or as_good:
            ratio = (here.cost - cost) / predicted if predicted > 0 else 0.0
            ended = last or (here.cost - cost < small and ratio > TRUSTED)
            settled = ended and far == 0
            damping *= max(0.1, 1 - (2 * min(ratio, 1.5) - 1) ** 3)
            damping, growth = max(damping, 1e-9), 2.0
            state, step, before = trial_state, proposal, (sizes.max(), predicted)
            here = here if there is None else there
            costs.append(cost)
            if observe is not None:
                observe(cost)
        else:
            ended = last or damping > 1e6
            settled = ended and bool(np.isfinite(here.cost))
            damping, growth = max(damping, 1e-4) * growth, growth * 2
    return Solution(state, tuple(costs), step, settled)


def _to_come(now: float, before: float) -> float:
    """What the steps after this one add up to, if they go on to shrink as this one did; at least this step itself.

    With a ratio q of this step to the one before, that is q / (1 − q) times this step: where steps shrink slowly, a
    small one is far from the last.
    """
    ratio = min(now / before, SLOWEST) if before > 0 else 0.0
    return now * max(1.0, ratio / (1 - ratio))


def damped_step(at: Linearization, damping: float, forcing: float = FORCING) -> Float:
    """The step (δ, ε) ``(N + k,)``, ε of what is not eliminated alone."""
    if not is_small(at.hessian):
        return _iterated_step(at, damping, forcing)
    solve = inverse(at.hessian, damping)
    plain = solve(at.gradient)
    if at.border.shape[1] == 0:
        return -plain
    across = solve(at.border)
    slope = np.zeros(len(at.corner))
    slope[len(slope) - len(at.slope) :] = at.slope
    corner = _damped_corner(at, damping)
    left = pseudo_inverse(corner - at.border.T @ across, like=np.diagonal(corner))
    few = left @ (at.border.T @ plain - slope)
    return np.concatenate([-(plain + across @ few), few[len(few) - len(at.slope) :]])


def _damped_corner(at: Linearization, damping: float) -> Float:
    """D, with damping on what steps."""
    first = len(at.corner) - len(at.slope)
    corner = at.corner.copy()
    corner[range(first, len(corner)), range(first, len(corner))] *= 1 + damping
    return corner


def eliminated(at: Linearization, damping: float) -> tuple[Callable[[Float], Float], Float, Float]:
    """x ↦ (H + λ diag H − B D⁺ Bᵀ) x, D⁺, and the blocks on the diagonal of H + λ diag H."""
    few = pseudo_inverse(_damped_corner(at, damping))
    product, blocks = damped_product(at.hessian, damping)
    return lambda x: product(x) - at.border @ (few @ (at.border.T @ x)), few, blocks


def _iterated_step(at: Linearization, damping: float, forcing: float) -> Float:
    """The same by conjugate gradients on what is left of H once ε is eliminated."""
    slope = np.zeros(len(at.corner))
    slope[len(slope) - len(at.slope) :] = at.slope
    product, few, blocks = eliminated(at, damping)
    most = MAX_STEP_ITERATIONS if forcing >= FORCING else MAX_ITERATIONS
    own = conjugate_gradients(product, blocks, at.border @ (few @ slope) - at.gradient, forcing, most)
    rest = -few @ (slope + at.border.T @ own)
    return np.concatenate([own, rest[len(rest) - len(at.slope) :]])


def predicted_decrease(at: Linearization, step: Float, damping: float) -> float:
    """Decrease that the quadratic model promises for a ``step`` of `damped_step`."""
    own, few = step[: len(at.gradient)], step[len(at.gradient) :]
    slopes = float(at.gradient @ own) + float(at.slope @ few)
    metric = float(own @ (np.asarray(at.hessian.diagonal()) * own))
    metric += float(few @ (np.diagonal(at.corner)[len(at.corner) - len(few) :] * few))
    return 0.5 * (damping * metric - slopes)
