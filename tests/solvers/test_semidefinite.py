"""Systems with a matrix JᵀJ (`solvers.semidefinite`): directions without data are fixed, and nothing is raised."""

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
    """A matrix with an eigenvalue made negative by sums in single precision, which once raised an exception.

    A grain with hardly any data (5e-3 on the diagonal) beside one with many (417).
    """
    J = np.random.default_rng(3).normal(size=(50, 6)) * np.sqrt([417 / 50] * 3 + [5e-3 / 50] * 3)
    J[:, 4] = J[:, 3]
    matrix = J.T @ J
    matrix[3, 4] = matrix[4, 3] = matrix[3, 3] + 6.3e-5
    return matrix


class TestSolver:
    @pytest.mark.parametrize("damping", [0.0, 1e-4, 10.0])
    @pytest.mark.parametrize("columns", [None, 3])
    def test_solution_of_a_regular_matrix_is_exact(self, damping, columns):
        units = np.array([1e-3, 1.0, 1e4, 1e2])
        H = information() * np.outer(units, units)
        b = RNG.normal(size=4 if columns is None else (4, columns))
        damped = H + damping * np.diag(np.diagonal(H))
        x = damped_solver(H, damping)(b)
        np.testing.assert_allclose((damped @ x).ravel(), b.ravel(), atol=1e-8)

    def test_a_negative_eigenvalue_by_rounding_raises_nothing(self):
        H = rounded()
        assert np.linalg.eigvalsh(H).min() < -1e-5
        for damping in (0.0, 1e-9, 1e-4, 1e-2):
            x = damped_solver(H, damping)(np.ones(6))
            assert np.isfinite(x).all()
            assert np.ones(6) @ x > 0  # a descent direction

    def test_a_direction_without_data_does_not_change(self):
        J = RNG.normal(size=(20, 3))
        J[:, 2] = J[:, 1]
        x = damped_solver(J.T @ J)(J.T @ (J @ [1.0, 2.0, 4.0]))
        np.testing.assert_allclose(x, [1, 3, 3], atol=1e-8)

    def test_the_solution_does_not_depend_on_the_size_of_rounding(self):
        """An eigenvalue that is a rounding error of either sign has no effect."""
        J = RNG.normal(size=(20, 3))
        J[:, 2] = J[:, 1]
        b = J.T @ RNG.normal(size=20)
        solutions = []
        for noise in (-1e-13, 0.0, 1e-13):
            H = J.T @ J
            H[1, 2] = H[2, 1] = H[1, 2] * (1 + noise)
            solutions.append(damped_solver(H)(b))
        np.testing.assert_allclose(solutions[0], solutions[1], rtol=1e-9, atol=1e-12)
        np.testing.assert_allclose(solutions[2], solutions[1], rtol=1e-9, atol=1e-12)

    def test_an_unknown_without_data_does_not_change(self):
        H = information()
        H[2] = H[:, 2] = 0
        x = damped_solver(H, 1e-4)(np.array([1.0, 2.0, 0.0, 3.0]))
        assert x[2] == 0
        H[2, 2] = 1e-25  # rounding errors are no information
        assert damped_solver(H, 1e-4)(np.ones(4))[2] == 0


class TestPseudoInverse:
    def test_equals_least_squares_in_any_units(self):
        C, b = RNG.normal(size=(30, 4)), RNG.normal(size=30)
        scaled = C * UNITS
        solution = pseudo_inverse(scaled.T @ scaled) @ (scaled.T @ b) * UNITS
        np.testing.assert_allclose(solution, np.linalg.lstsq(C, b, rcond=None)[0], atol=1e-8)

    def test_equal_columns_share_and_empty_ones_are_zero(self):
        a = RNG.normal(size=30)
        C = np.stack([a, a, np.zeros(30)], axis=1)
        np.testing.assert_allclose(pseudo_inverse(C.T @ C) @ (C.T @ (3 * a)), [1.5, 1.5, 0], atol=1e-6)

    def test_inverts_stacks_of_matrices(self):
        many = np.stack([information(seed=k) for k in range(5)])
        np.testing.assert_allclose(pseudo_inverse(many), np.linalg.inv(many), atol=1e-9)

    def test_of_an_empty_matrix(self):
        assert pseudo_inverse(np.zeros((0, 0))).shape == (0, 0)

    def test_a_difference_is_compared_with_its_minuend(self):
        """A Schur complement that is zero but for rounding is treated as zero."""
        difference = np.diag([1.0, 3e-14])
        np.testing.assert_array_equal(pseudo_inverse(difference, like=np.array([1.0, 1.0])), np.diag([1.0, 0.0]))
        assert pseudo_inverse(difference)[1, 1] == pytest.approx(1 / 3e-14)


@pytest.mark.parametrize("solve", [damped_solver, pseudo_inverse, unresolved_information])
@pytest.mark.parametrize("place", [(1, 1), (0, 2)])
def test_a_matrix_that_is_not_finite_is_refused(solve, place):
    H = information()
    H[place] = H[place[::-1]] = np.nan
    with pytest.raises(np.linalg.LinAlgError, match="not finite"):
        solve(H)


class TestUnresolvedInformation:
    def test_is_zero_for_regular_matrices(self):
        many = np.stack([information(columns=6, seed=k) for k in range(4)])
        np.testing.assert_array_equal(unresolved_information(many), 0)

    def test_constrains_the_unresolved_direction_and_no_other(self):
        J = RNG.normal(size=(20, 6)) * [1, 1, 1, 1e-3, 1e-3, 1e-3]
        J[:, 5] = J[:, 4]
        H = J.T @ J
        added = unresolved_information(H[None])[0]
        direction = np.array([0, 0, 0, 0, 1, -1.0])
        assert direction @ added @ direction == pytest.approx(direction @ np.diag(np.diagonal(H)) @ direction, rel=1e-6)
        across = np.linalg.svd(direction[None])[2][1:]
        np.testing.assert_allclose(added @ across.T @ across @ H @ np.ones(6), 0, atol=1e-6)
        scale = unit_scale(np.diagonal(H))
        assert np.linalg.eigvalsh((H + added) * np.outer(scale, scale)).min() > 1e3 * RESOLVED_EIGENVALUE

    def test_is_one_for_unknowns_without_data(self):
        np.testing.assert_array_equal(unresolved_information(np.zeros((2, 6, 6))), np.tile(np.eye(6), (2, 1, 1)))
