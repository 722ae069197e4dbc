"""The line integral along one ray: chords of a box, and sums of voxels."""

import numpy as np
import pytest

from grainmotion.kernels import ray_tracing

SHAPE = (7, 9, 8)  # z, y, x
VOXEL = 0.5  # mm
both_projectors = pytest.mark.parametrize("exact", [False, True], ids=["trilinear", "exact"])


def padded(array):
    return np.pad(np.asarray(array, float), 2)


def random_rays(count=200, seed=0):
    """Rays through points near the middle of the padded image, in voxels; directions have length 1/voxel size."""
    rng = np.random.default_rng(seed)
    middle = np.array(SHAPE[::-1]) / 2 + 1.5
    points = middle + rng.uniform(-3, 3, (count, 3))
    directions = rng.normal(size=(count, 3))
    directions /= VOXEL * np.linalg.norm(directions, axis=1, keepdims=True)
    return points, directions


def integral(image, point, direction, exact):
    return ray_tracing.line_integral(image.ravel(), image.shape, tuple(point), tuple(direction), exact)


def test_exact_integral_of_a_constant_box_is_the_chord_length():
    image = padded(np.full(SHAPE, 3.0))
    low, high = 1.5, np.array(SHAPE[::-1]) + 1.5  # faces of the filled voxels
    for point, direction in zip(*random_rays(), strict=True):
        first, second = (low - point) / direction, (high - point) / direction
        chord = np.maximum(first, second).min() - np.minimum(first, second).max()  # mm
        assert integral(image, point, direction, True) == pytest.approx(3.0 * max(chord, 0), abs=1e-12)


@both_projectors
@pytest.mark.parametrize("axis", [0, 1, 2], ids="xyz")
def test_ray_along_an_axis_sums_a_line_of_voxels(axis, exact):
    array = np.random.default_rng(1).normal(size=SHAPE)
    point, direction = np.array([4.0, 5.0, 6.0]), np.eye(3)[axis] / VOXEL
    line = [4 - 2, 5 - 2, 6 - 2]
    line[axis] = slice(None)
    expected = VOXEL * array[line[2], line[1], line[0]].sum()
    assert integral(padded(array), point, direction, exact) == pytest.approx(expected, abs=1e-12)


@both_projectors
def test_reversed_ray_has_the_same_integral(exact):
    image = padded(np.random.default_rng(2).normal(size=SHAPE))
    for point, direction in zip(*random_rays(50), strict=True):
        forward, backward = (integral(image, point, sign * direction, exact) for sign in (1, -1))
        assert backward == pytest.approx(forward, abs=1e-12)


@both_projectors
def test_ray_that_misses_the_image_has_zero_integral(exact):
    image = padded(np.ones(SHAPE))
    assert integral(image, (0.0, -20.0, 0.0), (1.0, 0.0, 0.0), exact) == 0
    assert integral(image, (0.0, -20.0, 0.0), (0.6, 0.8, 0.0), exact) == 0


@pytest.mark.parametrize("cone", [True, False], ids=["cone", "parallel"])
def test_ray_of_a_pixel(cone):
    source, detector, u, v = [0.0, -30.0, 0.0], [1.0, 50.0, 2.0], [0.2, 0.0, 0.0], [0.0, 0.05, 0.3]
    first = source if cone else [0.0, 2.0, 0.5]
    ray = ray_tracing.pixel_ray(np.array([*first, *detector, *u, *v]), cone, -1.5, 4.0)
    pixel = np.array(detector) + 4 * np.array(u) - 1.5 * np.array(v)
    direction = pixel - source if cone else np.array(first)
    np.testing.assert_allclose(ray[:3], pixel)
    np.testing.assert_allclose(ray[3:], direction / np.linalg.norm(direction))
