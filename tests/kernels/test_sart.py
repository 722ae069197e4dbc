"""SART: lengths of rays in the field of view, normalised residuals, and constraints on voxels."""

import numpy as np
import pytest

from grainmotion.kernels import sart

N, RADIUS = 21, 8.0
MIDDLE = (N - 1) / 2


@pytest.mark.parametrize("distance", [0.0, 3.0, 7.9])
def test_chord_of_a_cylinder(distance):
    half = np.sqrt(RADIUS**2 - distance**2)
    assert sart.chord(MIDDLE, MIDDLE + distance, MIDDLE, 1.0, 0, 0, N, N, N, RADIUS) == pytest.approx(2 * half)
    assert sart.chord(MIDDLE + distance, MIDDLE, MIDDLE, 0, 2.0, 0, N, N, N, RADIUS) == pytest.approx(half)


def test_ray_along_the_axis_or_beside_the_cylinder():
    assert sart.chord(MIDDLE, MIDDLE, 0, 0, 0, 1.0, N, N, N, RADIUS) == pytest.approx(N - 1, abs=0.01)
    assert sart.chord(0.5, 0.5, 0, 0, 0, 1.0, N, N, N, RADIUS) == 0
    assert sart.chord(MIDDLE, MIDDLE + 8.1, MIDDLE, 1.0, 0, 0, N, N, N, RADIUS) == 0
    assert sart.chord(MIDDLE, MIDDLE + 8.1, MIDDLE, 1.0, 0, 0, N, N, N, 0.0) == pytest.approx(N - 1, abs=0.01)


def test_residuals_are_divided_by_the_length_of_the_ray():
    """Parallel rays along x: pixels that are masked, and rays that miss the cylinder, count as zero.

    The ray in column 30 grazes the cylinder, and counts as four voxels long.
    """
    voxel, pixel = 0.5, 0.39
    rows, columns = 2, 41
    views = np.array([[1.0, 0, 0, 20, 0, 0, 0, pixel, 0, 0, 0, pixel]])
    rng = np.random.default_rng(0)
    images, measured = rng.uniform(size=(2, 1, rows, columns))
    valid = np.ones((1, rows, columns), bool)
    valid[0, 1, 18] = False
    squares = np.zeros((rows, 2))
    projected = images.copy()
    origin, size = np.full(3, -MIDDLE * voxel), (N, N, N)
    sart.compare(images, measured, valid, origin, voxel, size, RADIUS, views, False, 0, rows, squares)
    distance = pixel * (np.arange(columns) - 20)
    length = 2 * np.sqrt(np.maximum((RADIUS * voxel) ** 2 - distance**2, 0))
    assert 3 * voxel < length[30] < 4 * voxel
    counts = valid & (length > 0)
    expected = np.where(counts, (measured - projected) / np.maximum(length, 4 * voxel), 0)
    np.testing.assert_allclose(images, expected, atol=1e-12)
    np.testing.assert_allclose(squares[:, 0], (((measured - projected) ** 2) * counts).sum(axis=(0, 2)))
    np.testing.assert_allclose(squares[:, 1], (measured**2 * counts).sum(axis=(0, 2)))


def constrained(image):
    y, x = np.indices(image.shape[:2]) - (np.array(image.shape[:2]) - 1).reshape(2, 1, 1) / 2
    inside = np.zeros(image.shape, bool)
    inside[2:-2, 2:-2, 2:-2] = True
    return np.where(inside & (x**2 + y**2 <= 4.0**2)[..., None], np.maximum(image, -0.1), 0)


def test_constraints_on_voxels():
    image = np.random.default_rng(1).normal(size=(13, 12, 9))
    expected = constrained(image)
    sart.constrain(image, 2, 4.0, -0.1)
    np.testing.assert_array_equal(image, expected)


def test_extrapolation_starts_from_the_constrained_image():
    image, before = np.random.default_rng(2).normal(size=(2, 13, 12, 9))
    before = constrained(before)
    expected = constrained(image)
    beyond = expected + 0.3 * (expected - before)
    sart.constrain_and_extrapolate(image, before, 2, 4.0, -0.1, 0.3)
    np.testing.assert_allclose(image, beyond, atol=1e-14)
    np.testing.assert_array_equal(before, expected)
