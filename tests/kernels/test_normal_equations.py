"""J x, Jᵀ y and blocks of JᵀJ against the Jacobian as a dense matrix."""

import numpy as np
import pytest

from grainmotion.kernels import normal_equations
from patch_tables import BOXES, DERIVATIVES, GRAINS, SHAPE, TABLE, dense_jacobian, pairs_of


def jvp(increments):
    images = np.full(SHAPE, np.nan)
    normal_equations.jvp(
        DERIVATIVES, BOXES, TABLE.offsets, TABLE.order, TABLE.view_starts, increments[None], images[None]
    )
    return images


def vjp(images):
    """Jᵀ y: the sums over each grain's patches."""
    parts = np.full((len(BOXES), 6), np.nan)
    normal_equations.vjp(DERIVATIVES, BOXES, TABLE.offsets, images[None], parts[None])
    out = np.zeros((GRAINS, 6))
    np.add.at(out, BOXES[:, 0], parts)
    return out


def test_products_are_those_of_the_dense_matrix():
    rng = np.random.default_rng(1)
    x, y = rng.normal(size=(GRAINS, 6)), rng.normal(size=SHAPE)
    np.testing.assert_allclose(jvp(x).ravel(), dense_jacobian() @ x.ravel(), atol=1e-13)
    np.testing.assert_allclose(vjp(y).ravel(), y.ravel() @ dense_jacobian(), atol=1e-13)


def test_vjp_is_the_adjoint_of_jvp():
    rng = np.random.default_rng(2)
    x, y = rng.normal(size=(GRAINS, 6)), rng.normal(size=SHAPE)
    assert np.vdot(jvp(x), y) == pytest.approx(np.vdot(x, vjp(y)), rel=1e-12)


def test_blocks_are_those_of_the_gram_matrix():
    blocks = [(0, 0), (0, 1), (1, 1), (1, 2), (0, 2)]
    pairs = [pairs_of(*block) for block in blocks]
    first = np.concatenate([[0], np.cumsum([len(p) for p in pairs])])
    out = np.full((len(blocks), 6, 6), np.nan)
    normal_equations.gram_blocks(DERIVATIVES, BOXES, TABLE.offsets, np.concatenate(pairs), first, out)
    gram = dense_jacobian().T @ dense_jacobian()
    for (one, other), block in zip(blocks, out, strict=True):
        np.testing.assert_allclose(block, gram[6 * one : 6 * one + 6, 6 * other : 6 * other + 6], atol=1e-12)


def test_patches_that_do_not_overlap_have_a_zero_block():
    out = np.full((1, 6, 6), np.nan)
    apart = np.array([[0, 1]])  # of one grain in two views: rows 0 to 4, and rows 28 to 35
    normal_equations.gram_blocks(DERIVATIVES, BOXES, TABLE.offsets, apart, np.array([0, 1]), out)
    assert not out.any()
