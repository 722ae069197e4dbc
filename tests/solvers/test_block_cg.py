"""Block-preconditioned conjugate gradients (`solvers.block_cg`) and diagonal blocks."""

import numpy as np
from scipy import sparse

from grainmotion.solvers.block_cg import conjugate_gradients, damped_product, diagonal_blocks, inverse, worth_while


def positive(n: int = 4, seed: int = 0) -> np.ndarray:
    """A positive definite matrix of n × n blocks."""
    factor = np.random.default_rng(seed).normal(size=(8 * n, 6 * n))
    return factor.T @ factor


def test_diagonal_blocks():
    blocks = np.random.default_rng(2).normal(size=(5, 6, 6))
    whole = sparse.bsr_array((blocks, np.arange(5), np.arange(6)), shape=(30, 30))
    np.testing.assert_array_equal(diagonal_blocks(whole), blocks)
    missing = sparse.bsr_array((blocks[:1], [1], [0, 1, 1]), shape=(12, 12), blocksize=(6, 6))
    assert not diagonal_blocks(missing).any()


def test_each_column_is_solved_to_its_own_tolerance():
    matrix = positive()
    right = np.random.default_rng(1).normal(size=(24, 3)) * [1.0, 1e-6, 1e6]
    product, blocks = damped_product(matrix, 0.0)
    solution = conjugate_gradients(product, blocks, right, 1e-9)
    residual = np.linalg.norm(matrix @ solution - right, axis=0) / np.linalg.norm(right, axis=0)
    assert residual.max() < 1e-8


def test_conjugate_gradients_equal_the_dense_solution(monkeypatch):
    matrix, right = positive(), np.random.default_rng(1).normal(size=24)
    dense = inverse(matrix, 0.1)(right)
    np.testing.assert_allclose(dense, np.linalg.solve(matrix + 0.1 * np.diag(np.diagonal(matrix)), right))
    monkeypatch.setattr("grainmotion.solvers.block_cg.MAX_DENSE_UNKNOWNS", 0)
    np.testing.assert_allclose(inverse(matrix, 0.1)(right), dense, rtol=1e-6)


def test_iterations_end_where_they_lower_the_quadratic_by_less_than_is_enough(monkeypatch):
    monkeypatch.setattr("grainmotion.solvers.block_cg.LEAST_SHARE_OF_DECREASE", 0.0)
    matrix, right = positive(20, seed=3), np.random.default_rng(1).normal(size=120)
    product, blocks = damped_product(matrix, 0.0)
    best = 0.5 * right @ np.linalg.solve(matrix, right)
    steps = []

    def counting(x):
        steps.append(1)
        return product(x)

    def decrease(enough):
        steps.clear()
        x = conjugate_gradients(counting, blocks, right, 1e-9, 500, enough)
        return right @ x - 0.5 * x @ (matrix @ x), len(steps)

    rough, few = decrease(0.05 * best)
    fine, more = decrease(1e-6 * best)
    assert few < more
    assert rough > 0.5 * best
    assert fine > 0.999 * best


def test_iterations_are_worth_while_while_they_gain():
    assert worth_while([1.0], 10.0)  # too few to tell
    assert worth_while([1.0] * 5, 1.0)
    assert not worth_while([1.0] * 5 + [0.01] * 5, 0.1)
    assert not worth_while([100.0] * 5 + [0.5] * 5, 1.0)  # little of the decrease so far
