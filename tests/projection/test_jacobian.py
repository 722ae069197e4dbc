"""Jacobian of the radiographs with respect to the grains' motions: its products, columns and blocks of JᵀJ."""

from dataclasses import replace

import numpy as np
import pytest

import few_grains
from grainmotion.model.pose import Pose
from grainmotion.objective.normal_matrix import PatchNormalMatrix
from grainmotion.projection.footprints import footprint_patches
from grainmotion.projection.grain_arrays import GrainArrays
from grainmotion.projection.grains import assemble, differentiate_in_place
from grainmotion.projection.patch_products import products_by_grain

GRAINS = GrainArrays.of(few_grains.grain_set(finer=1))
VIEWS = few_grains.geometry()
N = len(GRAINS)


@pytest.fixture(scope="module")
def jacobian():
    """Derivatives at the reference positions, in double precision, masked and filtered."""
    grains = replace(GRAINS, images=GRAINS.images.astype(float))
    pose = Pose(np.zeros((N, 3)), np.broadcast_to(np.eye(3), (N, 3, 3)).copy())
    patches = footprint_patches(grains, pose, VIEWS, margin=2)
    _, computed = differentiate_in_place(grains, pose, VIEWS, patches, "trilinear")
    valid = np.random.default_rng(4).uniform(size=patches.stack_shape) < 0.9
    computed.filter(valid.astype(float), np.array([0.5, 0.2, 0.05]))
    return computed


def test_gradient_is_the_adjoint_of_images(jacobian):
    rng = np.random.default_rng(1)
    x, y = rng.normal(size=(N, 6)), rng.normal(size=jacobian.patches.stack_shape)
    (images,) = jacobian.images(x[None])
    assert np.vdot(images, y) == pytest.approx(np.vdot(x, jacobian.gradient(y)), rel=1e-9)


def test_column_is_the_image_of_one_derivative(jacobian):
    grain, k = 2, 4
    unit = np.zeros((1, N, 6))
    unit[0, grain, k] = 1
    boxes, offsets = jacobian.patches.boxes, jacobian.patches.offsets
    mine = np.repeat(boxes[:, 0] == grain, np.diff(offsets))
    column = assemble(np.where(mine, jacobian.derivatives[k], 0), jacobian.patches, VIEWS)
    np.testing.assert_allclose(jacobian.images(unit)[0], column, atol=1e-12)
    assert column.any()


def test_products_by_grain_equal_those_of_its_own_blocks(jacobian):
    whole = products_by_grain(jacobian.derivatives, jacobian.derivatives[2:4], jacobian.patches)
    np.testing.assert_allclose(whole, PatchNormalMatrix(jacobian).blocks()[:, :, 2:4], rtol=1e-9, atol=1e-12)
    assert whole.shape == (N, 6, 2)


def test_gram_blocks_equal_those_of_the_dense_matrix(jacobian):
    """J as a dense matrix with a column for each motion component of each grain."""
    dense = np.stack([image.ravel() for image in jacobian.images(np.eye(6 * N).reshape(-1, N, 6))], axis=1)
    boxes = jacobian.patches.boxes
    views_of = [{boxes[p, 1]: p for p in np.flatnonzero(boxes[:, 0] == g)} for g in range(N)]
    for g, h in ((1, 1), (0, 1), (3, 4)):
        pairs = np.array([(views_of[g][i], views_of[h][i]) for i in views_of[g].keys() & views_of[h].keys()])
        (block,) = jacobian.gram_blocks(pairs, np.array([0, len(pairs)]))
        expected = dense[:, 6 * g : 6 * g + 6].T @ dense[:, 6 * h : 6 * h + 6]
        np.testing.assert_allclose(block, expected, atol=1e-9 * np.abs(dense.T @ dense).max())


def test_copy_has_its_own_derivatives(jacobian):
    other = jacobian.copy()
    other.derivatives[:] = 0
    assert other.patches is jacobian.patches
    assert np.any(jacobian.derivatives)
