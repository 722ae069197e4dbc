"""Systems with a matrix JᵀJ: solved where the data resolve a direction, held where not, and never an exception."""

import numpy as np
import pytest

from grainmotion.solvers.semidefinite import (
    RESOLVED_EIGENVALUE,
    damped_solver,
    pseudo_inverse,
    unit_scale,
    unresolved_information,
)

RNG = np.random.default_rng(0)
UNITS = np.array([1e-6, 1.0, 1e5, 1e2])


def information(rows=30, columns=4, seed=0):
    """A well conditioned JᵀJ."""
    J = np.random.default_rng(seed).normal(size=(rows, columns))
    return J.T @ J


def rounded():
    """The matrix of a run that once ended in an exception, in small: single sums made an eigenvalue negative.

    A grain with hardly any shadow (5e-3 on the diagonal) beside one with a large one (417).
    """
    J = np.random.default_rng(3).normal(size=(50, 6)) * np.sqrt([417 / 50] * 3 + [5e-3 / 50] * 3)
    J[:, 4] = J[:, 3]
    matrix = J.T @ J
    matrix[3, 4] = matrix[4, 3] = matrix[3, 3] + 6.3e-5
    return matrix


class TestSolver:
    @pytest.mark.parametrize("damping", [0.0, 1e-4, 10.0])
    @pytest.mark.parametrize("columns", [None, 3])
    def test_of_a_regular_matrix_is_the_exact_solution(self, damping, columns):
        units = np.array([1e-3, 1.0, 1e4, 1e2])
        H = information() * np.outer(units, units)
        b = RNG.normal(size=4 if columns is None else (4, columns))
        damped = H + damping * np.diag(np.diagonal(H))
        x = damped_solver(H, damping)(b)
        np.testing.assert_allclose((damped @ x).ravel(), b.ravel(), atol=1e-8)

    def test_a_negative_eigenvalue_by_rounding_is_no_exception(self):
        H = rounded()
        assert np.linalg.eigvalsh(H).min() < -1e-5
        for damping in (0.0, 1e-9, 1e-4, 1e-2):
            x = damped_solver(H, damping)(np.ones(6))
            assert np.isfinite(x).all()
            assert np.ones(6) @ x > 0  # a way downhill

    def test_a_direction_without_data_is_held(self):
        J = RNG.normal(size=(20, 3))
        J[:, 2] = J[:, 1]
        x = damped_solver(J.T @ J)(J.T @ (J @ [1.0, 2.0, 4.0]))
        np.testing.assert_allclose(x, [1, 3, 3], atol=1e-8)

    def test_how_large_the_rounding_is_does_not_show(self):
        """What rounding leaves of an eigenvalue, of either sign, decides nothing."""
        J = RNG.normal(size=(20, 3))
        J[:, 2] = J[:, 1]
        b = J.T @ RNG.normal(size=20)
        ends = []
        for noise in (-1e-13, 0.0, 1e-13):
            H = J.T @ J
            H[1, 2] = H[2, 1] = H[1, 2] * (1 + noise)
            ends.append(damped_solver(H)(b))
        np.testing.assert_allclose(ends[0], ends[1], rtol=1e-9, atol=1e-12)
        np.testing.assert_allclose(ends[2], ends[1], rtol=1e-9, atol=1e-12)

    def test_an_unknown_that_nothing_sees_stays(self):
        H = information()
        H[2] = H[:, 2] = 0
        x = damped_solver(H, 1e-4)(np.array([1.0, 2.0, 0.0, 3.0]))
        assert x[2] == 0
        H[2, 2] = 1e-25  # rounding errors are no information
        assert damped_solver(H, 1e-4)(np.ones(4))[2] == 0


class TestPseudoInverse:
    def test_is_least_squares_in_any_units(self):
        C, b = RNG.normal(size=(30, 4)), RNG.normal(size=30)
        scaled = C * UNITS
        found = pseudo_inverse(scaled.T @ scaled) @ (scaled.T @ b) * UNITS
        np.testing.assert_allclose(found, np.linalg.lstsq(C, b, rcond=None)[0], atol=1e-8)

    def test_columns_alike_share_and_empty_ones_stay_at_zero(self):
        a = RNG.normal(size=30)
        C = np.stack([a, a, np.zeros(30)], axis=1)
        np.testing.assert_allclose(pseudo_inverse(C.T @ C) @ (C.T @ (3 * a)), [1.5, 1.5, 0], atol=1e-6)

    def test_of_many_matrices_at_once(self):
        many = np.stack([information(seed=k) for k in range(5)])
        np.testing.assert_allclose(pseudo_inverse(many), np.linalg.inv(many), atol=1e-9)

    def test_of_nothing(self):
        assert pseudo_inverse(np.zeros((0, 0))).shape == (0, 0)

    def test_what_a_difference_leaves_is_measured_against_the_minuend(self):
        """A Schur complement that cancels but for rounding says nothing, though its own diagonal is all it has."""
        left = np.diag([1.0, 3e-14])
        np.testing.assert_array_equal(pseudo_inverse(left, like=np.array([1.0, 1.0])), np.diag([1.0, 0.0]))
        assert pseudo_inverse(left)[1, 1] == pytest.approx(1 / 3e-14)


@pytest.mark.parametrize("solve", [damped_solver, pseudo_inverse, unresolved_information])
@pytest.mark.parametrize("place", [(1, 1), (0, 2)])
def test_a_matrix_that_is_not_finite_is_refused(solve, place):
    H = information()
    H[place] = H[place[::-1]] = np.nan
    with pytest.raises(np.linalg.LinAlgError, match="not finite"):
        solve(H)


class TestUnresolved:
    def test_nothing_is_added_to_regular_matrices(self):
        many = np.stack([information(columns=6, seed=k) for k in range(4)])
        np.testing.assert_array_equal(unresolved_information(many), 0)

    def test_holds_the_direction_and_no_other(self):
        J = RNG.normal(size=(20, 6)) * [1, 1, 1, 1e-3, 1e-3, 1e-3]
        J[:, 5] = J[:, 4]
        H = J.T @ J
        held = unresolved_information(H[None])[0]
        way = np.array([0, 0, 0, 0, 1, -1.0])
        assert way @ held @ way == pytest.approx(way @ np.diag(np.diagonal(H)) @ way, rel=1e-6)
        across = np.linalg.svd(way[None])[2][1:]
        np.testing.assert_allclose(held @ across.T @ across @ H @ np.ones(6), 0, atol=1e-6)
        scale = unit_scale(np.diagonal(H))
        assert np.linalg.eigvalsh((H + held) * np.outer(scale, scale)).min() > 1e3 * RESOLVED_EIGENVALUE

    def test_unseen_unknowns_get_one(self):
        np.testing.assert_array_equal(unresolved_information(np.zeros((2, 6, 6))), np.tile(np.eye(6), (2, 1, 1)))
