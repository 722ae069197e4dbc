"""The normal matrix as a product (`objective.normal_matrix`), against its explicit blocks."""

from dataclasses import replace

import numpy as np
import pytest

import few_grains
from grainmotion.model.pose import Pose
from grainmotion.model.scan import Scan
from grainmotion.objective.data_term import Target
from grainmotion.objective.normal_matrix import PatchNormalMatrix, normal_matrix, normal_of
from grainmotion.objective.residual import StateProblem
from grainmotion.projection.grain_arrays import GrainArrays
from grainmotion.projection.jacobian import PatchJacobian
from grainmotion.solvers.block_cg import diagonal_blocks

GRAINS = GrainArrays.of(few_grains.grain_set(finer=1))
VIEWS = few_grains.geometry()
N = len(GRAINS)


@pytest.fixture(scope="module")
def evaluation():
    scan = Scan(np.zeros((len(VIEWS), *VIEWS.shape)), VIEWS)
    grains = replace(GRAINS, images=GRAINS.images.astype(float))
    problem = StateProblem(grains, Target(scan, np.zeros(scan.line_integrals.shape), "trilinear", 1.5))
    return problem.evaluate_with_derivatives(Pose(np.zeros((N, 3)), np.broadcast_to(np.eye(3), (N, 3, 3)).copy()))


@pytest.fixture(scope="module")
def product(evaluation):
    return PatchNormalMatrix(evaluation.jacobian)


def test_product_equals_the_matrix(evaluation, product):
    matrix = normal_matrix(evaluation.jacobian)
    assert matrix.toarray().shape == product.shape
    for x in np.random.default_rng(0).normal(size=(3, 6 * N)):
        np.testing.assert_allclose(product @ x, matrix @ x, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(product.blocks(), diagonal_blocks(matrix), rtol=1e-9)
    np.testing.assert_allclose(product.diagonal(), matrix.diagonal(), rtol=1e-9)


def test_a_prior_is_added_to_the_blocks(product):
    prior = np.random.default_rng(2).normal(size=(N, 6, 6))
    prior = prior @ prior.transpose(0, 2, 1)
    x = np.random.default_rng(3).normal(size=6 * N)
    with_prior = product.lifted(prior).lifted(prior)
    expected = product @ x + 2 * np.einsum("nij,nj->ni", prior, x.reshape(N, 6)).ravel()
    np.testing.assert_allclose(with_prior @ x, expected)
    np.testing.assert_allclose(with_prior.blocks(), product.blocks() + 2 * prior)


def test_a_grain_without_a_patch_has_zero_rows(evaluation, product):
    kept = evaluation.patches.boxes[:, 0] != 1
    rows = np.concatenate([np.full(d, k) for d, k in zip(np.diff(evaluation.patches.offsets), kept, strict=True)])
    patches = replace(evaluation.patches, boxes=evaluation.patches.boxes[kept], jobs=evaluation.patches.jobs[:0])
    without = PatchNormalMatrix(PatchJacobian(evaluation.jacobian.derivatives[:, rows], patches))
    assert not without.blocks()[1].any()
    assert not (without @ np.ones(6 * N)).reshape(N, 6)[1].any()


def test_many_grains_get_a_product_instead_of_blocks(evaluation, monkeypatch):
    assert not isinstance(normal_of(evaluation.jacobian), PatchNormalMatrix)
    monkeypatch.setattr("grainmotion.objective.normal_matrix.MAX_DENSE_UNKNOWNS", 6 * N - 1)
    assert isinstance(normal_of(evaluation.jacobian), PatchNormalMatrix)
