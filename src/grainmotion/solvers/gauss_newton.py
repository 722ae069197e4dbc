"""Damped Gauss–Newton (Levenberg–Marquardt) on block-sparse normal equations; knows no X-rays.

Minimises ½‖r(x)‖² over many unknowns with a sparse matrix, and a few that couple with all of them.  Of these few, the
linear ones are already eliminated exactly from r (variable projection; Golub and Pereyra 1973, in Kaufman's form);
the others step together with the many.  One damped step solves

    [H + λ diag H   B] [δ]     [g]
    [     Bᵀ        D] [ε] = − [h],     H = JᵀJ,  B = JᵀC,  D = CᵀC,  g = Jᵀr,  h = Cᵀr,

with h zero for the eliminated unknowns, and λ diag D added to D for the others, so that damping shortens every step.
H is sparse in blocks; B has few columns, so the Schur complement on them is small and dense.  The damping follows
Nielsen (1999).

Small problems are solved by a dense Cholesky factor.  Large ones have an H that is a product only (`NormalMatrix`).
There ε is eliminated first,  (H + λ diag H − B D⁺ Bᵀ) δ = −g + B D⁺ h,  and solved by conjugate gradients,
preconditioned by the 6×6 blocks on the diagonal of H, to the accuracy that a Gauss–Newton step needs
(`stopping.DEFAULT_FORCING`).  Decision 0015 holds the measurements.

A step has no component along directions that the data do not resolve (`semidefinite`), and costs are compared only as
far as their digits are significant (`SIGNIFICANT_COST_CHANGE`), so that no result depends on how a processor rounds.
Decision 0016 says why.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Generic, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from grainmotion._typing import Float
from grainmotion.solvers.block_cg import (
    MAX_CG_ITERATIONS,
    Hessian,
    conjugate_gradients,
    damped_product,
    inverse,
    is_small,
)
from grainmotion.solvers.semidefinite import pseudo_inverse
from grainmotion.solvers.stopping import DEFAULT_FORCING, Stopping, little_gained

State = TypeVar("State")

ENOUGH_OF_DECREASE, MAX_CG_ITERATIONS_PER_STEP = 0.2, 200
"""Conjugate gradients of a step end at the relative residual `Stopping.forcing`, or once several iterations together
lower the cost by less than this share of the decrease that ends the stage (`block_cg.worth_while`), or after so many
iterations."""

MAX_DAMPING_NEAR_MINIMUM = 1e-2
"""Damping up to which a small decrease means that the minimum is near, not that damping kept the step short."""

MIN_DECREASE_RATIO = 0.25
"""A small decrease ends the iteration only if it is at least this share of what the quadratic model predicted."""

MAX_EXTRAPOLATED_RATIO = 0.9
"""Largest ratio of a step to the one before that is extrapolated: beyond it, steps hardly shrink."""

MIN_STEP_LENGTH = 0.25
"""Least share of a step that is taken where the cost bends more than its quadratic model."""

SIGNIFICANT_COST_CHANGE = 1e-6
"""Relative change of the cost that is significant: residuals in single precision give the cost to some 1e-7."""


@dataclass(frozen=True, eq=False)
class Linearization:
    """The problem at one state.

    Attributes
    ----------
    cost : float
        ½‖r‖² with the linear unknowns at their best.
    gradient : (N,) array
        g = Jᵀr.
    hessian : (N, N) array, sparse matrix or NormalMatrix
        JᵀJ, in 6×6 blocks if it is no array.
    border : (N, m) array
        B = JᵀC; m may be 0.
    corner : (m, m) array
        D = CᵀC.
    border_gradient : (k,) array
        h of the last k of those m, which are not eliminated but step with the others; k may be 0.
    """

    cost: float
    gradient: Float
    hessian: Hessian
    border: Float
    corner: Float
    border_gradient: Float = field(default_factory=lambda: np.zeros(0))


class Problem(Protocol[State]):
    """A residual, as the solver needs it."""

    def linearize(self, state: State) -> Linearization:
        """Cost, gradient and normal matrix at a state."""
        ...

    def cost(self, state: State) -> float:
        """The cost alone, which is cheaper."""
        ...

    def retract(self, state: State, step: Float) -> State:
        """The state after a step ``(N + k,)``."""
        ...

    def step_sizes(self, state: State, step: Float) -> Float:
        """Displacement of each moving object by a step, in the unit of the tolerance."""
        ...


@dataclass(frozen=True, eq=False)
class Solution(Generic[State]):
    """The state where the solver ended, the cost after each accepted step, whether it settled and whether it paused.

    ``moving`` are the objects that still moved while all others rested (see `Stopping.few`), None if there are none.
    """

    state: State
    costs: tuple[float, ...]
    last_step: Float
    settled: bool = field(default=False)
    paused: bool = False
    moving: NDArray[np.bool_] | None = None

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

    The solution has ``settled`` if a step or the decrease fell below its tolerance, or no step lowers the cost any
    more; it has not if the iterations ran out, or objects still move further than the straggler distance.
    """
    stopping = stopping or Stopping()
    state, trial = start, None
    current: Linearization | None = problem.linearize(start)
    assert current is not None
    costs, tried = [current.cost], [current.cost]  # after each accepted step, and the least after each step tried
    damping, growth, length = 1e-4, 2.0, stopping.first_length
    step = np.zeros(len(current.gradient) + len(current.border_gradient))
    previous = np.inf, np.inf  # size and predicted decrease of the step before
    ended, settled, paused, rejected = False, False, False, 0
    moving: NDArray[np.bool_] | None = None
    while len(costs) <= stopping.iterations and not ended:
        before = costs[-1]
        if current is None:
            current = problem.linearize(state)
        proposal = damped_step(current, damping, stopping.forcing, ENOUGH_OF_DECREASE * stopping.decrease * before)
        parabola = _Parabola.along(current, proposal, damping)
        proposal, predicted = length * proposal, parabola.decrease(length)
        trial_state, sizes = problem.retract(state, proposal), problem.step_sizes(state, proposal)
        near = damping <= MAX_DAMPING_NEAR_MINIMUM
        far = float((sizes > stopping.straggler_distance).mean())
        small = stopping.decrease * before if near and far <= stopping.stragglers else 0.0
        last = _remaining(sizes.max(), previous[0]) < stopping.step or _remaining(predicted, previous[1]) < small
        if not last and near and far > stopping.stragglers and (sizes > stopping.rest).mean() <= stopping.few:
            last, moving = True, sizes > stopping.rest
        if not (last or is_small(current.hessian)):
            current = trial = None  # two normal matrices of many grains are not held at once
        trial = None if last else problem.linearize(trial_state)
        cost = problem.cost(trial_state) if trial is None else trial.cost
        as_good = last and predicted > 0 and near and cost <= (1 + SIGNIFICANT_COST_CHANGE) * before
        if stopping.interpolate:
            length = parabola.best_length(length, before - cost)
        if cost < before or as_good:
            ratio = (before - cost) / predicted if predicted > 0 else 0.0
            ended = last or (before - cost < small and ratio > MIN_DECREASE_RATIO)
            settled = ended and far == 0
            moving, rejected = moving if ended else None, 0
            damping *= max(0.1, 1 - (2 * min(ratio, 1.5) - 1) ** 3)
            damping, growth = max(damping, 1e-9), 2.0
            state, step, previous = trial_state, proposal, (sizes.max(), predicted)
            current = current if trial is None else trial
            costs.append(cost)
            if observe is not None:
                observe(cost)
        else:
            trial, rejected = None, rejected + 1
            given_up = rejected >= stopping.rejections and len(costs) > 1
            ended, moving = (last and moving is None) or damping > 1e6 or given_up, None
            settled = ended and bool(np.isfinite(before))
            damping, growth = max(damping, 1e-4) * growth, growth * 2
        tried.append(costs[-1])
        if len(costs) > stopping.pause_after and not ended and costs[-1] < stopping.pause_cost:
            ended = paused = little_gained(tried, stopping)
    return Solution(state, tuple(costs), step, settled, paused, moving)


@dataclass(frozen=True)
class _Parabola:
    """The decrease of the cost along a step that the quadratic model predicts, from its ``slope`` at the start and the
    ``full`` decrease by the whole step.
    """

    slope: float
    full: float

    @classmethod
    def along(cls, at: Linearization, step: Float, damping: float) -> _Parabola:
        return cls(_slope(at, step), predicted_decrease(at, step, damping))

    def decrease(self, length: float) -> float:
        """The decrease by a part of the step."""
        return length * self.full + length * (1 - length) * (self.slope - self.full)

    def best_length(self, length: float, found: float) -> float:
        """The part of a step that lowers the cost most, if the one taken lowered it by ``found``."""
        bend = (length * self.slope - found) / length**2
        if not np.isfinite(bend):
            return MIN_STEP_LENGTH
        return float(np.clip(self.slope / (2 * bend), MIN_STEP_LENGTH, 1.0)) if bend > 0 else 1.0


def _remaining(current: float, previous: float) -> float:
    """Sum of the steps after this one if they go on to shrink as this one did; at least this step itself.

    With a ratio q of this step to the one before, that is q / (1 − q) times this step: where steps shrink slowly, a
    small one is far from the last.
    """
    ratio = min(current / previous, MAX_EXTRAPOLATED_RATIO) if previous > 0 else 0.0
    return current * max(1.0, ratio / (1 - ratio))


def damped_step(at: Linearization, damping: float, forcing: float = DEFAULT_FORCING, enough: float = 0.0) -> Float:
    """The step (δ, ε) ``(N + k,)``, with ε of the k unknowns that are not eliminated.

    That of a large problem is solved to the relative residual ``forcing``, or until iterations lower the cost by less
    than is ``enough``.
    """
    k = len(at.border_gradient)
    if not is_small(at.hessian):
        return _iterated_step(at, damping, forcing, enough)
    solve = inverse(at.hessian, damping)
    own = solve(at.gradient)
    if at.border.shape[1] == 0:
        return -own
    across = solve(at.border)
    corner = _damped_corner(at, damping)
    complement = pseudo_inverse(corner - at.border.T @ across, like=np.diagonal(corner))
    border_step = complement @ (at.border.T @ own - _full_border_gradient(at))
    return np.concatenate([-(own + across @ border_step), border_step[len(border_step) - k :]])


def _full_border_gradient(at: Linearization) -> Float:
    """h ``(m,)``, zero for the eliminated unknowns."""
    gradient = np.zeros(len(at.corner))
    gradient[len(gradient) - len(at.border_gradient) :] = at.border_gradient
    return gradient


def _damped_corner(at: Linearization, damping: float) -> Float:
    """D, damped for the unknowns that are not eliminated."""
    first = len(at.corner) - len(at.border_gradient)
    corner = at.corner.copy()
    corner[range(first, len(corner)), range(first, len(corner))] *= 1 + damping
    return corner


def schur_complement(at: Linearization, damping: float) -> tuple[Callable[[Float], Float], Float, Float]:
    """x ↦ (H + λ diag H − B D⁺ Bᵀ) x, D⁺, and the blocks on the diagonal of H + λ diag H."""
    corner_inverse = pseudo_inverse(_damped_corner(at, damping))
    product, blocks = damped_product(at.hessian, damping)
    return lambda x: product(x) - at.border @ (corner_inverse @ (at.border.T @ x)), corner_inverse, blocks


def _iterated_step(at: Linearization, damping: float, forcing: float, enough: float) -> Float:
    """Solve the Schur complement by preconditioned conjugate gradients."""
    gradient = _full_border_gradient(at)
    product, corner_inverse, blocks = schur_complement(at, damping)
    iterations = MAX_CG_ITERATIONS_PER_STEP if forcing >= DEFAULT_FORCING else MAX_CG_ITERATIONS
    right = at.border @ (corner_inverse @ gradient) - at.gradient
    own = conjugate_gradients(product, blocks, right, forcing, iterations, enough)
    border_step = -corner_inverse @ (gradient + at.border.T @ own)
    return np.concatenate([own, border_step[len(border_step) - len(at.border_gradient) :]])


def predicted_decrease(at: Linearization, step: Float, damping: float) -> float:
    """Decrease that the quadratic model predicts for a ``step`` of `damped_step`."""
    own, rest = step[: len(at.gradient)], step[len(at.gradient) :]
    metric = float(own @ (np.asarray(at.hessian.diagonal()) * own))
    metric += float(rest @ (np.diagonal(at.corner)[len(at.corner) - len(rest) :] * rest))
    return 0.5 * (damping * metric + _slope(at, step))


def _slope(at: Linearization, step: Float) -> float:
    """Decrease of the cost by a unit of a step, to first order."""
    own, rest = step[: len(at.gradient)], step[len(at.gradient) :]
    return -(float(at.gradient @ own) + float(at.border_gradient @ rest))
