"""Kernel of Gibbs sampling: candidates and costs on a problem whose best candidate is known."""

import numpy as np

from grainmotion.kernels import gibbs_sampling


def problem():
    """One grain with 4 rotations in 2 views; the true one is rotation 2, moved by (1, −2) pixels in both views."""
    rng = np.random.default_rng(3)
    tables = rng.integers(0, 4096, (4, 2 * 5 * 6)).astype(np.float32)
    anchors = np.array([[6, 7], [8, 6]])
    images = np.zeros((2, 20, 22))
    for v, (r, c) in enumerate(anchors):
        images[v, r + 1 : r + 6, c - 2 : c + 4] = tables[2, 30 * v : 30 * v + 30].reshape(5, 6)
    energies = (tables.astype(float) ** 2).reshape(4, 2, 30).sum(axis=2)
    return images, tables, energies, anchors


def run(temperatures, images, rotation=0, move=12):
    """Anneal from the given rotation and shift; returns cost, rotation and shift of the result."""
    images = images.copy()
    _, tables, energies, anchors = problem()
    steps = np.arange(-2.0, 3.0)
    shifts = np.stack([a.ravel() for a in np.meshgrid(steps, steps, [0.0], indexing="ij")], axis=1)
    gradients = np.zeros((1, 2, 2, 3))
    gradients[:, :, 0, 0] = gradients[:, :, 1, 1] = 1
    rotation_of, shift_of = np.array([rotation]), np.array([move])
    gibbs_sampling._add_grain(
        images, tables, np.array([[0, 1]]), anchors, np.full((2, 2), (5, 6)), np.array([0, 30, 60]), gradients, 0,
        rotation, shifts[move], -1.0,
    )  # fmt: skip
    cost = gibbs_sampling.anneal(
        np.random.default_rng(0), np.asarray(temperatures, float), (256, 512), images, tables, energies,
        np.array([[0, 1]]), anchors, np.full((2, 2), (5, 6)), np.array([0, 30, 60]), gradients, shifts,
        np.array([2, 2]), rotation_of, shift_of,
    )  # fmt: skip
    return cost, rotation_of[0], shifts[shift_of[0]]


def test_best_candidate_is_chosen_at_temperature_zero():
    cost, rotation, shift = run([0.0], problem()[0])
    assert rotation == 2
    np.testing.assert_array_equal(shift, [1, -2, 0])
    assert cost == 0


def test_returned_cost_belongs_to_the_returned_candidates():
    """At a high temperature, where candidates are drawn nearly at random."""
    images, tables, _, anchors = problem()
    cost, rotation, shift = run([1e12] * 5, images)
    residual = images.astype(float).copy()
    for v, (r, c) in enumerate(anchors + shift[:2].astype(int)):
        residual[v, r : r + 5, c : c + 6] -= tables[rotation, 30 * v : 30 * v + 30].reshape(5, 6)
    assert cost == (residual**2).sum()
