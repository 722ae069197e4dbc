"""Global parameters as image columns (`objective.global_parameters`): products, against dense matrices."""

import numpy as np
import pytest

from grainmotion.objective.global_parameters import Columns, dot
from grainmotion.projection.footprints import Patches
from grainmotion.projection.jacobian import PatchJacobian

VIEWS, PANEL = 3, (9, 11)
KINDS = {
    "shared": (True,),
    "per view": (False,),
    "both": (True, False, True, False),
    "other order": (False, True),
}
every_kind = pytest.mark.parametrize("kind", KINDS.values(), ids=KINDS.keys())


def columns(kind, seed=0):
    rng = np.random.default_rng(seed)
    out = Columns()
    for shared in kind:
        out.add(rng.normal(size=(VIEWS, *PANEL)).astype(np.float32), shared)
    return out


def dense(columns):
    """C ``(pixels, m)``."""
    parts = []
    for stack, shared in zip(columns.stacks, columns.shared, strict=True):
        for view in [slice(None)] if shared else range(VIEWS):
            column = np.zeros((VIEWS, *PANEL))
            column[view] = stack[view]
            parts.append(column.ravel())
    return np.stack(parts, axis=1)


def patches(grains: int) -> Patches:
    """Patches in three views of the first three grains of a set."""
    rng = np.random.default_rng(2)
    corners = rng.integers(0, 5, (8, 2))
    sizes = rng.integers(1, 5, (8, 2))
    grain, view = [0, 0, 0, 1, 1, 2, 2, 2], [0, 1, 2, 0, 2, 1, 2, 0]
    boxes = np.column_stack(
        [grain, view, corners[:, 0], corners[:, 0] + sizes[:, 0], corners[:, 1], corners[:, 1] + sizes[:, 1]]
    )
    return Patches(boxes, np.zeros((0, 4), np.int64), np.ones((grains, VIEWS)), PANEL)


class TestProducts:
    @every_kind
    def test_gram_matrix(self, kind):
        C = dense(columns(kind))
        np.testing.assert_allclose(columns(kind).gram(), C.T @ C, rtol=1e-4, atol=1e-4)

    @every_kind
    def test_products_with_an_image(self, kind):
        image = np.random.default_rng(1).normal(size=(VIEWS, *PANEL)).astype(np.float32)
        np.testing.assert_allclose(columns(kind).dot(image), dense(columns(kind)).T @ image.ravel(), rtol=1e-4)

    @every_kind
    def test_products_with_the_jacobian(self, kind):
        patches_of_four = patches(4)
        derivatives = np.random.default_rng(3).normal(size=(6, patches_of_four.offsets[-1])).astype(np.float32)
        J = np.zeros((VIEWS, *PANEL, 4, 6))  # the fourth grain has no patch
        for p, (grain, view, r0, r1, c0, c1) in enumerate(patches_of_four.boxes):
            patch = derivatives[:, patches_of_four.offsets[p] : patches_of_four.offsets[p + 1]].reshape(
                6, r1 - r0, c1 - c0
            )
            J[view, r0:r1, c0:c1, grain] += patch.transpose(1, 2, 0)
        expected = J.reshape(-1, 24).T @ dense(columns(kind))
        np.testing.assert_allclose(
            columns(kind).border(PatchJacobian(derivatives, patches_of_four)), expected, atol=1e-4
        )

    @every_kind
    def test_linear_combinations(self, kind):
        c = columns(kind)
        coefficients = np.random.default_rng(4).normal(size=len(c.owners))
        np.testing.assert_allclose(c.combine(coefficients).ravel(), dense(c) @ coefficients, atol=1e-5)

    def test_owners_of_sums_of_columns(self):
        one, other = columns((True, False)), columns((False,), 5)
        np.testing.assert_array_equal(one.owners, [0, 1, 1, 1])
        both = one + other
        np.testing.assert_array_equal(both.owners, [0, 1, 1, 1, 2, 2, 2])
        assert len(one.stacks) == 2  # a sum changes neither
        np.testing.assert_allclose(both.gram()[:4, :4], one.gram())

    def test_without_columns(self):
        no_columns = Columns()
        assert no_columns.gram().shape == (0, 0)
        assert no_columns.dot(np.zeros((VIEWS, *PANEL))).shape == (0,)
        assert no_columns.border(PatchJacobian(np.zeros((6, patches(3).offsets[-1])), patches(3))).shape == (18, 0)


def test_products_of_single_precision_are_summed_in_double():
    """Many small terms and a large one: sums in single precision would lose the small ones."""
    a, b = np.full((2, 100, 100), 1e-4, np.float32), np.ones((2, 100, 100), np.float32)
    a[0, 0, 0] = 1e4
    assert dot(a, b) == pytest.approx(1e4 + 1.9999, rel=1e-9)
