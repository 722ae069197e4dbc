"""Filters of radiographs and patches: symmetric, zero beyond the panel, and mass is kept away from its edge."""

import numpy as np
import pytest
from scipy import ndimage

from grainmotion.kernels import filters

WEIGHTS = np.array([0.4, 0.2, 0.1])  # half of a symmetric kernel whose sum is 1
WHOLE_KERNEL = np.concatenate([WEIGHTS[:0:-1], WEIGHTS])


def filtered(images):
    out = images.copy()
    filters.filter_images(out, WEIGHTS)
    return out


def test_images_beyond_the_edge_are_zero():
    images = np.random.default_rng(0).normal(size=(2, 7, 9))
    expected = images
    for axis in (1, 2):
        expected = ndimage.convolve1d(expected, WHOLE_KERNEL, axis, mode="constant")
    np.testing.assert_allclose(filtered(images), expected, atol=1e-14)


def test_filter_is_its_own_adjoint():
    x, y = np.random.default_rng(1).normal(size=(2, 3, 7, 9))
    assert np.vdot(filtered(x), y) == pytest.approx(np.vdot(x, filtered(y)), rel=1e-12)


@pytest.mark.parametrize(("row", "column", "mass"), [(4, 5, 1.0), (0, 5, 0.7), (4, 8, 0.7), (0, 0, 0.49)])
def test_mass_is_kept_except_for_what_leaves_the_panel(row, column, mass):
    images = np.zeros((1, 9, 9))
    images[0, row, column] = 1
    assert filtered(images).sum() == pytest.approx(mass)


def test_kernel_wider_than_the_image():
    images = np.ones((1, 1, 2))
    np.testing.assert_allclose(filtered(images), np.full((1, 1, 2), 0.4 * (0.4 + 0.2)))


def test_patches_are_masked_and_then_filtered_each_on_its_own():
    rng = np.random.default_rng(2)
    boxes = np.array([[0, 1, 1, 5, 2, 8], [1, 0, 0, 3, 0, 4]])
    offsets = np.array([0, 24, 36])
    valid = (rng.uniform(size=(2, 6, 9)) < 0.7).astype(float)
    derivatives = rng.normal(size=(6, 36))
    expected = []
    for (_, view, r0, r1, c0, c1), start, end in zip(boxes, offsets[:-1], offsets[1:], strict=True):
        patch = derivatives[:, start:end].reshape(6, r1 - r0, c1 - c0) * valid[view, r0:r1, c0:c1]
        expected.append(filtered(patch).reshape(6, -1))
    filters.filter_patches(derivatives, boxes, offsets, valid, WEIGHTS)
    np.testing.assert_allclose(derivatives, np.concatenate(expected, axis=1), atol=1e-14)
