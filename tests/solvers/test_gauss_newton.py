"""Damped Gauss–Newton (`solvers.gauss_newton`) on problems whose optimum is known."""

import weakref
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import pytest
from scipy import sparse
from scipy.optimize import least_squares

from grainmotion.solvers import block_cg
from grainmotion.solvers.gauss_newton import Linearization, damped_step, gauss_newton, predicted_decrease
from grainmotion.solvers.stopping import MIN_STEPS_BEFORE_PAUSE, PAUSE_TRIALS, Stopping

Array = np.ndarray


@dataclass(frozen=True, eq=False)
class LeastSquares:
    """½‖r(x) − C y‖² with y eliminated; x a plain vector."""

    residual: Callable[[Array], Array]
    jacobian: Callable[[Array], Array]
    linear: Array | None = None  # C
    wrap: Callable[[Array], object] = np.asarray

    def linearize(self, state: Array) -> Linearization:
        r, J = self.residual(state), self.jacobian(state)
        C = np.zeros((len(r), 0)) if self.linear is None else self.linear
        r = r - C @ np.linalg.lstsq(C, r, rcond=None)[0]
        return Linearization(0.5 * float(r @ r), J.T @ r, self.wrap(J.T @ J), J.T @ C, C.T @ C)

    def cost(self, state: Array) -> float:
        return self.linearize(state).cost

    def retract(self, state: Array, step: Array) -> Array:
        return state + step

    def step_sizes(self, state: Array, step: Array) -> Array:
        return np.array([np.linalg.norm(step)])


@dataclass(frozen=True)
class KnownOptimum:
    """A start, the optimum and its cost."""

    problem: LeastSquares
    start: Array
    optimum: Array
    cost: float = 0.0


def linear() -> KnownOptimum:
    rng = np.random.default_rng(0)
    A, b = rng.normal(size=(12, 4)), rng.normal(size=12)
    best = np.linalg.lstsq(A, b, rcond=None)[0]
    problem = LeastSquares(lambda x: A @ x - b, lambda x: A)
    return KnownOptimum(problem, np.full(4, 5.0), best, 0.5 * float(((A @ best - b) ** 2).sum()))


def badly_scaled() -> KnownOptimum:
    """Unknowns of sizes 1e-4 and 1e4, as mm and radians may be: damping must not depend on the scale."""
    rng = np.random.default_rng(1)
    A, best = rng.normal(size=(9, 3)) * [1e4, 1.0, 1e-4], np.array([1e-4, 1.0, 1e4])
    return KnownOptimum(LeastSquares(lambda x: A @ (x - best), lambda x: A), np.zeros(3), best)


def rosenbrock() -> KnownOptimum:
    return KnownOptimum(
        LeastSquares(
            lambda x: np.array([10 * (x[1] - x[0] ** 2), 1 - x[0]]),
            lambda x: np.array([[-20 * x[0], 10.0], [-1.0, 0.0]]),
        ),
        np.array([-1.2, 1.0]),
        np.ones(2),
    )


def powell() -> KnownOptimum:
    """Powell's singular function: the Jacobian loses rank at the optimum."""
    return KnownOptimum(
        LeastSquares(
            lambda x: np.array(
                [x[0] + 10 * x[1], 5**0.5 * (x[2] - x[3]), (x[1] - 2 * x[2]) ** 2, 10**0.5 * (x[0] - x[3]) ** 2]
            ),
            lambda x: np.array(
                [
                    [1, 10, 0, 0],
                    [0, 0, 5**0.5, -(5**0.5)],
                    [0, 2 * (x[1] - 2 * x[2]), -4 * (x[1] - 2 * x[2]), 0],
                    [2 * 10**0.5 * (x[0] - x[3]), 0, 0, -2 * 10**0.5 * (x[0] - x[3])],
                ]
            ),
        ),
        np.array([3.0, -1.0, 0.0, 1.0]),
        np.zeros(4),
    )


def exponential() -> KnownOptimum:
    """y = 2 exp(−1.3 t) + 0.5 exactly, all three unknown."""
    t = np.linspace(0, 4, 30)
    y = 2 * np.exp(-1.3 * t) + 0.5
    return KnownOptimum(
        LeastSquares(
            lambda x: x[0] * np.exp(-x[1] * t) + x[2] - y,
            lambda x: np.stack([np.exp(-x[1] * t), -x[0] * t * np.exp(-x[1] * t), np.ones_like(t)], axis=1),
        ),
        np.array([1.0, 0.2, 0.0]),
        np.array([2.0, 1.3, 0.5]),
    )


def exponential_with_eliminated_amplitudes() -> KnownOptimum:
    """The same with amplitude and offset eliminated, as gain and offset of a radiograph are.

    With y the best amplitudes at x, r = data − C(x) y; its Jacobian in Kaufman's form is −∂C y, projected.
    """
    t = np.linspace(0, 4, 30)
    y = 2 * np.exp(-1.3 * t) + 0.5

    class Eliminated(LeastSquares):
        def linearize(self, state: Array) -> Linearization:
            C = np.stack([np.exp(-state[0] * t), np.ones_like(t)], axis=1)
            amplitudes = np.linalg.lstsq(C, y, rcond=None)[0]
            r = y - C @ amplitudes
            J = (amplitudes[0] * t * np.exp(-state[0] * t))[:, None]
            return Linearization(0.5 * float(r @ r), J.T @ r, J.T @ J, J.T @ C, C.T @ C)

    return KnownOptimum(Eliminated(np.asarray, np.asarray), np.array([0.1]), np.array([1.3]))


KNOWN = {
    f.__name__: f
    for f in (linear, badly_scaled, rosenbrock, powell, exponential, exponential_with_eliminated_amplitudes)
}


class TestKnownOptima:
    @pytest.mark.parametrize("name", KNOWN)
    def test_optimum_is_reached(self, name):
        known = KNOWN[name]()
        solution = gauss_newton(known.problem, known.start, Stopping(iterations=200, step=1e-7, decrease=1e-14))
        assert solution.settled
        assert solution.costs[-1] == pytest.approx(known.cost, abs=1e-12)
        # Powell's optimum is singular: convergence is linear there
        np.testing.assert_allclose(solution.state, known.optimum, rtol=1e-6, atol=5e-3 if name == "powell" else 1e-6)

    @pytest.mark.parametrize("name", KNOWN)
    def test_costs_only_fall(self, name):
        known = KNOWN[name]()
        reported = []
        solution = gauss_newton(known.problem, known.start, Stopping(iterations=50), reported.append)
        assert (np.diff(solution.costs) < 0).all()
        assert list(solution.costs[1:]) == reported
        assert solution.iterations == len(reported)
        assert known.problem.cost(solution.state) == solution.costs[-1]

    def test_a_linear_problem_takes_at_most_three_steps(self):
        known = linear()
        assert gauss_newton(known.problem, known.start, Stopping(step=1e-6)).iterations <= 3

    def test_rank_deficient_normal_matrix(self):
        """An unknown without data does not change, and the others are solved."""
        rng = np.random.default_rng(2)
        A = np.concatenate([rng.normal(size=(9, 3)), np.zeros((9, 1))], axis=1)
        b = rng.normal(size=9)
        solution = gauss_newton(LeastSquares(lambda x: A @ x - b, lambda x: A), np.array([1.0, 1, 1, 7.0]))
        np.testing.assert_allclose(solution.state[:3], np.linalg.lstsq(A[:, :3], b, rcond=None)[0], atol=1e-6)
        assert solution.state[3] == 7.0
        assert solution.settled

    def test_two_unknowns_of_which_only_the_sum_is_determined(self):
        A = np.ones((5, 2))
        solution = gauss_newton(LeastSquares(lambda x: A @ x - 3, lambda x: A), np.zeros(2))
        assert solution.state.sum() == pytest.approx(3, abs=1e-5)
        np.testing.assert_allclose(solution.state[0], solution.state[1], atol=1e-6)


SLOW = LeastSquares(lambda x: np.append(x, 1.0), lambda x: np.array([[10.0], [0.0]]))
"""x² + 1 with derivatives that are ten times too large: steps are a tenth of what they should be."""


class TestStopping:
    def test_iterations_are_limited(self):
        known = rosenbrock()
        solution = gauss_newton(known.problem, known.start, Stopping(iterations=2, step=1e-12))
        assert solution.iterations == 2
        assert not solution.settled

    def test_a_start_at_the_optimum_settles_at_once(self):
        known = rosenbrock()
        solution = gauss_newton(known.problem, known.optimum)
        assert solution.settled
        assert solution.iterations == 0
        np.testing.assert_array_equal(solution.state, known.optimum)

    def test_a_small_step_settles(self):
        known = rosenbrock()
        solution = gauss_newton(known.problem, known.start, Stopping(iterations=500, step=0.5))
        assert solution.settled
        assert np.linalg.norm(solution.last_step) < 0.5

    def test_a_small_decrease_settles(self):
        known = powell()
        solution = gauss_newton(known.problem, known.start, Stopping(iterations=500, step=0.0, decrease=0.999))
        assert solution.settled
        assert solution.costs[-1] > 0.001 * solution.costs[-2]

    def test_a_last_step_is_not_linearised_at_its_end(self):
        """No further step follows, and the cost alone is cheaper."""
        known, linearized_states = linear(), []

        class Counted(LeastSquares):
            def linearize(self, state: Array) -> Linearization:
                linearized_states.append(state)
                return LeastSquares.linearize(self, state)

            def cost(self, state: Array) -> float:
                return LeastSquares.linearize(self, state).cost

        problem = Counted(known.problem.residual, known.problem.jacobian)
        solution = gauss_newton(problem, known.start, Stopping(step=1e9))
        assert solution.settled
        assert solution.iterations == 1
        assert len(linearized_states) == 1
        assert solution.costs[-1] == problem.cost(solution.state)

    @pytest.mark.parametrize(("share", "settled"), [(0.0, True), (0.4, True), (0.6, False)])
    def test_settles_despite_a_share_of_stragglers(self, share, settled):
        """One of two unknowns moves far with little effect on the cost; iteration goes on unless half may straggle."""

        class Each(LeastSquares):
            def step_sizes(self, state: Array, step: Array) -> Array:
                return np.abs(step)

        scale = np.array([1.0, 1e-6])
        problem = Each(
            lambda x: np.append(scale * np.tanh(x - 3), 1.0),
            lambda x: np.vstack([np.diag(scale / np.cosh(x - 3) ** 2), np.zeros(2)]),
        )
        stopping = Stopping(iterations=60, step=1e-9, decrease=1e-3, straggler_distance=0.01, stragglers=share)
        start = np.array([2.999, 2.0])
        solution = gauss_newton(problem, start, stopping)
        assert solution.settled == settled
        assert (abs(solution.state[1] - 3) < 0.01) == settled

    def test_a_heavily_damped_step_is_no_convergence(self):
        """A small decrease counts only if damping is light, because heavy damping makes any step small."""
        known = rosenbrock()
        solution = gauss_newton(known.problem, known.start, Stopping(iterations=500, step=1e-9, decrease=1e-6))
        np.testing.assert_allclose(solution.state, known.optimum, atol=1e-4)

    def test_pauses_where_little_is_left_of_a_small_cost(self):
        """Unsettled, and from there it goes on to where it would have ended."""
        stopping = Stopping(iterations=200, step=0.0, decrease=1e-6)
        paused = gauss_newton(SLOW, np.array([3.0]), replace(stopping, pause=0.5))
        assert paused.paused
        assert not paused.settled
        assert MIN_STEPS_BEFORE_PAUSE <= paused.iterations < 30
        assert paused.costs[-1 - PAUSE_TRIALS] - paused.costs[-1] < 0.5 * paused.costs[-1]
        assert not gauss_newton(SLOW, np.array([3.0]), replace(stopping, pause=0.5, pause_cost=0.4)).paused
        end = gauss_newton(SLOW, paused.state, stopping)
        assert end.costs[-1] < paused.costs[-1]
        assert abs(end.state[0]) < 0.02

    def test_pauses_soon_where_steps_creep_and_not_where_they_shrink(self):
        """Of a few steps that gain little the last tells: SLOW creeps, and exp x = 1 is solved by a few short ones."""
        stopping = Stopping(iterations=200, step=0.0, decrease=1e-9)
        soon = replace(stopping, pause=0.5, pause_trials=3, pause_after=3, creeping=True)
        creeping = gauss_newton(SLOW, np.array([3.0]), soon)
        assert creeping.paused
        assert creeping.iterations <= MIN_STEPS_BEFORE_PAUSE
        quick = LeastSquares(lambda x: np.append(np.exp(x) - 1, 10.0), lambda x: np.vstack([np.exp(x), [0.0]]))
        solved = gauss_newton(quick, np.array([1.5]), soon)
        assert not solved.paused
        assert abs(solved.state[0]) < 1e-3

    def test_goes_on_with_a_part_of_its_first_step(self):
        """On a parabola half of a step leaves a quarter of the cost; the next one is a whole one again."""
        parabola = LeastSquares(lambda x: np.append(x - 1, 0.0), lambda x: np.vstack([np.eye(1), [[0.0]]]))
        stopping = Stopping(iterations=2, step=0.0, decrease=0.0, interpolate=True, first_length=0.5)
        solution = gauss_newton(parabola, np.zeros(1), stopping)
        np.testing.assert_allclose(solution.costs[:2], [0.5, 0.125], rtol=1e-3)
        assert solution.costs[2] < 1e-6

    def test_without_a_downhill_step_the_state_does_not_change(self):
        """With a gradient of the wrong sign every step is refused, and iteration ends at the start."""
        wrong = LeastSquares(lambda x: x - 1, lambda x: -np.eye(2))
        solution = gauss_newton(wrong, np.zeros(2), Stopping(step=1e-12))
        assert solution.settled
        assert solution.iterations == 0
        np.testing.assert_array_equal(solution.state, [0, 0])

    def test_steps_to_a_nan_cost_are_shortened(self):
        """A step to a state with a cost of NaN is shortened, and the optimum is reached."""
        with np.errstate(invalid="ignore"):
            solution = gauss_newton(
                LeastSquares(lambda x: np.sqrt(x) - 1, lambda x: 0.5 / np.sqrt(x)[:, None] * np.eye(len(x))),
                np.array([8.0]),  # the plain Gauss–Newton step lands below zero
                Stopping(iterations=200, step=1e-9),
            )
        np.testing.assert_allclose(solution.state, [1.0], rtol=1e-6)


def blocks(n, seed=0, border=0):
    """A block-sparse linearisation of n grains, each coupled to the next two."""
    rng = np.random.default_rng(seed)
    J = sparse.lil_array((40 * n, 6 * n))
    for k in range(n):
        for neighbour in range(k, min(n, k + 3)):
            J[40 * k : 40 * k + 40, 6 * neighbour : 6 * neighbour + 6] = rng.normal(size=(40, 6))
    J = J.tocsr()
    r, C = rng.normal(size=40 * n), rng.normal(size=(40 * n, border))
    hessian = sparse.bsr_array(sparse.csr_array(J.T @ J), blocksize=(6, 6))
    return Linearization(0.5 * float(r @ r), J.T @ r, hessian, J.T @ C, C.T @ C), J.toarray(), r, C


class TestStep:
    @pytest.mark.parametrize("damping", [0.0, 0.1])
    @pytest.mark.parametrize("border", [0, 1, 2])
    def test_elimination_equals_the_joint_solution(self, damping, border):
        at, J, r, C = blocks(5, border=border)
        damped = J.T @ J + damping * np.diag(np.diagonal(J.T @ J))
        # r is at its best over y only after projection; the joint normal equations with that r
        r = r - C @ np.linalg.lstsq(C, r, rcond=None)[0]
        joint = np.block([[damped, J.T @ C], [C.T @ J, C.T @ C]])
        expected = np.linalg.solve(joint, -np.concatenate([J.T @ r, C.T @ r]))[: 6 * 5]
        step = damped_step(Linearization(at.cost, J.T @ r, at.hessian, at.border, at.corner), damping)
        np.testing.assert_allclose(step, expected, atol=1e-9)

    @pytest.mark.parametrize("border", [0, 2])
    def test_sparse_and_dense_matrices_give_the_same_step(self, border):
        at, *_ = blocks(4, 1, border)
        dense = Linearization(at.cost, at.gradient, at.hessian.toarray(), at.border, at.corner)
        np.testing.assert_allclose(damped_step(at, 1e-3), damped_step(dense, 1e-3))

    @pytest.mark.parametrize("damping", [0.0, 1e-4, 1.0])
    @pytest.mark.parametrize("border", [0, 2])
    def test_conjugate_gradients_equal_the_dense_solution(self, monkeypatch, damping, border):
        at, *_ = blocks(30, 2, border)
        dense = damped_step(at, damping)
        monkeypatch.setattr(block_cg, "MAX_DENSE_UNKNOWNS", 0)
        np.testing.assert_allclose(damped_step(at, damping, 1e-8), dense, atol=1e-6 * np.abs(dense).max())

    def test_conjugate_gradients_do_not_move_undetermined_grains(self, monkeypatch):
        at, J, r, _ = blocks(6, 3)
        J = J.copy()
        J[:, 12:18] = 0
        hessian = sparse.bsr_array(J.T @ J, blocksize=(6, 6))
        at = Linearization(1.0, J.T @ r, hessian, np.zeros((36, 0)), np.zeros((0, 0)))
        dense = damped_step(at, 1e-4)
        monkeypatch.setattr(block_cg, "MAX_DENSE_UNKNOWNS", 0)
        step = damped_step(at, 1e-4, 1e-8)
        np.testing.assert_array_equal(step[12:18], 0)
        np.testing.assert_allclose(step, dense, atol=1e-6 * np.abs(dense).max())

    def test_a_border_of_equal_columns(self):
        """Two equal columns, as gain and offset of a uniform radiograph: the step is that of one of them."""
        at, _, _, C = blocks(3, 4, 1)
        twice = np.concatenate([C, C], axis=1)
        J = blocks(3, 4, 1)[1]
        double = Linearization(at.cost, at.gradient, at.hessian, J.T @ twice, twice.T @ twice)
        np.testing.assert_allclose(damped_step(double, 0.1), damped_step(at, 0.1), atol=1e-8)

    @pytest.mark.parametrize("damping", [0.0, 1e-4])
    @pytest.mark.parametrize("dense", [600, 0])
    def test_a_matrix_indefinite_by_rounding_raises_nothing(self, monkeypatch, damping, dense):
        """The block of a grain with hardly any data is rounded: the steps of the others are those without it."""
        at, J, r, _ = blocks(3, 5)
        J = J.copy()
        J[:, 12:18] *= 1e-3
        J[:, 17] = J[:, 16]
        H = J.T @ J
        without = damped_step(Linearization(1.0, J[:, :17].T @ r, H[:17, :17], at.border[:17], at.corner), damping)
        H[16, 17] = H[17, 16] = H[16, 16] * (1 + 1e-4)
        monkeypatch.setattr(block_cg, "MAX_DENSE_UNKNOWNS", dense)
        hessian = sparse.bsr_array(H, blocksize=(6, 6))
        step = damped_step(Linearization(1.0, J.T @ r, hessian, np.zeros((18, 0)), at.corner), damping, 1e-9)
        assert np.isfinite(step).all()
        np.testing.assert_allclose(step[:12], without[:12], atol=1e-3)


def test_an_unknown_determined_by_rounding_errors_alone_does_not_change():
    """A column of rounding errors is no information: its unknown keeps its value, the others are solved."""
    a = np.random.default_rng(0).normal(size=(20, 3))
    a[:, 1] = 1e-16 * np.random.default_rng(1).normal(size=20)
    b = a[:, [0, 2]] @ [2.0, -1.0]
    solution = gauss_newton(LeastSquares(lambda x: a @ x - b, lambda x: a), np.zeros(3), Stopping(step=1e-12))
    np.testing.assert_allclose(solution.state, [2.0, 0.0, -1.0], atol=1e-9)


class TestSteppingBorder:
    """A border whose last unknowns are not eliminated but step with the others."""

    def problem(self, stepping=2, eliminated=1, seed=0):
        """r(x, y, z) = f(x, y) + C z, with x of the matrix, y stepping in the border and z eliminated."""
        rng = np.random.default_rng(seed)
        A, B, C = rng.normal(size=(40, 6)), rng.normal(size=(40, stepping)), rng.normal(size=(40, eliminated))
        truth = rng.normal(size=6 + stepping)
        b = rng.normal(size=40)

        def residual(state):
            x, y = state[:6], state[6:]
            return A @ np.sin(x) + B @ np.tanh(y) - b - 0.1 * (A @ x) * (B @ y)

        def jacobian(state):
            x, y = state[:6], state[6:]
            own = A * np.cos(x) - 0.1 * A * (B @ y)[:, None]
            few = B / np.cosh(y) ** 2 - 0.1 * B * (A @ x)[:, None]
            return np.hstack([own, few])

        class Bordered:
            def linearize(self, state):
                J, r = jacobian(state), residual(state)
                r = r - C @ np.linalg.lstsq(C, r, rcond=None)[0]
                own, both = J[:, :6], np.hstack([C, J[:, 6:]])
                return Linearization(
                    0.5 * float(r @ r), own.T @ r, own.T @ own, own.T @ both, both.T @ both, J[:, 6:].T @ r
                )

            def cost(self, state):
                return self.linearize(state).cost

            def retract(self, state, step):
                return state + step

            def step_sizes(self, state, step):
                return np.array([np.linalg.norm(step)])

        def reduced(state):
            r = residual(state)
            return r - C @ np.linalg.lstsq(C, r, rcond=None)[0]

        return Bordered(), reduced, 0.1 * truth

    @pytest.mark.parametrize("eliminated", [0, 1, 3])
    @pytest.mark.parametrize("stepping", [1, 2, 4])
    def test_the_optimum_is_that_of_scipy(self, stepping, eliminated):
        problem, reduced, start = self.problem(stepping, eliminated)
        expected = least_squares(reduced, start, xtol=1e-12, ftol=1e-12, gtol=1e-12)
        solution = gauss_newton(problem, start, Stopping(iterations=300, step=1e-10, decrease=1e-15))
        assert solution.settled
        assert solution.costs[-1] == pytest.approx(expected.cost, rel=1e-9)
        np.testing.assert_allclose(solution.state, expected.x, atol=1e-5)
        assert len(solution.last_step) == 6 + stepping
        assert (np.diff(solution.costs) < 1e-9 * solution.costs[-1]).all()  # but for rounding in a last step

    def test_damping_applies_to_stepping_unknowns(self):
        """The residual is strongly nonlinear in a stepping unknown, which oscillates without damping."""

        class Curved(LeastSquares):
            def linearize(self, state: Array) -> Linearization:
                r = np.array([state[0] - 1, 5 * np.tanh(state[1] - 2), 0.1])
                C = np.array([[0.0], [5 / np.cosh(state[1] - 2) ** 2], [0.0]])
                J = np.array([[1.0], [0.0], [0.0]])
                return Linearization(0.5 * float(r @ r), J.T @ r, J.T @ J, J.T @ C, C.T @ C, C.T @ r)

        solution = gauss_newton(Curved(np.asarray, np.asarray), np.zeros(2), Stopping(iterations=60, step=1e-9))
        np.testing.assert_allclose(solution.state, [1.0, 2.0], atol=1e-6)

    @pytest.mark.parametrize("damping", [0.0, 0.1])
    def test_one_step_equals_that_of_the_joint_equations(self, damping):
        """All stepping unknowns are damped; the gradient is zero for eliminated unknowns only."""
        at, J, r, C = blocks(5, border=3)
        first = C[:, :1]
        r = r - first @ np.linalg.lstsq(first, r, rcond=None)[0]
        damped = J.T @ J + damping * np.diag(np.diagonal(J.T @ J))
        stepping = np.diag([0.0, damping, damping] * np.diagonal(C.T @ C))
        joint = np.block([[damped, J.T @ C], [C.T @ J, C.T @ C + stepping]])
        expected = np.linalg.solve(joint, -np.concatenate([J.T @ r, C.T @ r]))
        step = damped_step(Linearization(1.0, J.T @ r, at.hessian, at.border, at.corner, C[:, 1:].T @ r), damping)
        np.testing.assert_allclose(step, np.delete(expected, 30), atol=1e-9)

    def test_the_cost_of_a_linear_problem_falls_as_predicted(self):
        """The predicted decrease is the actual one, with and without damping."""
        at, J, r, C = blocks(4, 6, 2)
        whole = Linearization(0.5 * float(r @ r), J.T @ r, at.hessian, at.border, at.corner, C.T @ r)
        for damping in (0.0, 0.3):
            step = damped_step(whole, damping)
            residual = r + J @ step[:24] + C @ step[24:]
            assert predicted_decrease(whole, step, damping) == pytest.approx(
                0.5 * float(r @ r - residual @ residual), rel=1e-9
            )

    def test_conjugate_gradients_equal_the_dense_step_with_a_border(self, monkeypatch):
        at, J, r, C = blocks(20, 7, 3)
        whole = Linearization(1.0, J.T @ r, at.hessian, at.border, at.corner, C[:, 1:].T @ r)
        dense = damped_step(whole, 1e-3)
        monkeypatch.setattr(block_cg, "MAX_DENSE_UNKNOWNS", 0)
        np.testing.assert_allclose(damped_step(whole, 1e-3, 1e-9), dense, atol=1e-6 * np.abs(dense).max())


@dataclass(frozen=True, eq=False)
class Objects(LeastSquares):
    """Unknowns that are objects, one each."""

    def step_sizes(self, state: Array, step: Array) -> Array:
        return np.abs(step)


def slow_and_quick() -> Objects:
    """One unknown with a root of order four, to which steps shrink by three quarters only, among 19 linear ones."""
    return Objects(
        lambda x: np.append(x[1:] - 1.0, 10 * (x[0] - 1.0) ** 4),
        lambda x: np.vstack([np.eye(20)[1:], 40 * (x[0] - 1.0) ** 3 * np.eye(20)[:1]]),
    )


def test_few_objects_that_move_while_the_others_rest_are_handed_over():
    start = np.zeros(20)
    stopping = Stopping(iterations=30, step=1e-4, straggler_distance=0.01, rest=0.01, few=0.1)
    solution = gauss_newton(slow_and_quick(), start, stopping)
    assert solution.moving is not None
    assert np.flatnonzero(solution.moving).tolist() == [0]
    assert not solution.settled
    alone = gauss_newton(slow_and_quick(), start, replace(stopping, few=0.0))
    assert alone.moving is None
    assert solution.iterations < alone.iterations


def test_rejected_steps_in_a_row_may_end_the_iteration():
    known = rosenbrock()
    many_steps = gauss_newton(known.problem, known.start, Stopping(iterations=100, step=1e-9, decrease=0.0))
    few_steps = gauss_newton(
        known.problem, known.start, Stopping(iterations=100, step=1e-9, decrease=0.0, rejections=1)
    )
    assert few_steps.iterations < many_steps.iterations
    assert few_steps.costs[-1] < few_steps.costs[0]


def bending_more_than_its_model(times: float) -> LeastSquares:
    """A linear problem whose model has but a part of the curvature, as under ripples of voxel images."""
    known = linear()
    share = 1 / np.sqrt(times)

    @dataclass(frozen=True, eq=False)
    class Rippled(LeastSquares):
        def linearize(self, state: Array) -> Linearization:
            at = super().linearize(state)
            return replace(at, hessian=share**2 * np.asarray(at.hessian))

    return Rippled(known.problem.residual, known.problem.jacobian)


@pytest.mark.parametrize("times", [1.9, 3.0])
def test_interpolated_steps_come_to_rest_where_full_ones_go_to_and_fro(times):
    known, stopping = linear(), Stopping(iterations=8, step=1e-9, decrease=0.0)
    problem = bending_more_than_its_model(times)
    full = gauss_newton(problem, known.start, stopping)
    shorter = gauss_newton(problem, known.start, replace(stopping, interpolate=True))
    np.testing.assert_allclose(shorter.state, known.optimum, atol=1e-6)
    assert np.abs(full.state - known.optimum).max() > 1e-3


def test_interpolation_leaves_exact_models_as_they_are():
    known, stopping = rosenbrock(), Stopping(iterations=30, step=1e-9)
    interpolated = gauss_newton(known.problem, known.start, replace(stopping, interpolate=True))
    np.testing.assert_allclose(interpolated.state, known.optimum, atol=1e-6)


@pytest.mark.parametrize(("bending", "refused"), [(0.2, False), (-0.2, True)])
def test_no_two_normal_matrices_of_many_unknowns_are_held_at_once(monkeypatch, bending, refused):
    """Also after a step that did not lower the cost, when that at its start is made again."""
    monkeypatch.setattr(block_cg, "MAX_DENSE_UNKNOWNS", 0)
    held, most, states = set(), [], []

    @dataclass(frozen=True, eq=False)
    class Counted(LeastSquares):
        def linearize(self, state: Array) -> Linearization:
            states.append(state.tobytes())
            at = super().linearize(state)
            matrix = sparse.bsr_array(np.asarray(at.hessian), blocksize=(6, 6))
            held.add(id(matrix))
            weakref.finalize(matrix, held.discard, id(matrix))
            most.append(len(held))
            return replace(at, hessian=matrix)

    rng = np.random.default_rng(2)
    A, bend = rng.normal(size=(30, 12)), rng.normal(size=(30, 12))
    start = np.full(12, 2.0 if bending > 0 else 0.05)
    problem = Counted(
        lambda x: A @ x + bending * (bend @ x) ** 2 - 1, lambda x: A + 2 * abs(bending) * (bend @ x)[:, None] * bend
    )
    gauss_newton(problem, start, Stopping(iterations=12, step=1e-9))
    assert len(most) > 4
    assert (len(set(states)) < len(states)) == refused
    assert max(most) == 1
