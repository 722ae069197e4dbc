"""Signed distance to a mesh (`simulate.signed_distance`): balls, cubes, and points on the surface."""

import numpy as np

from grainmotion.simulate import Ellipsoid, icosphere, polyhedron, sphere, stone
from grainmotion.simulate.shapes import CUBE_CORNERS
from grainmotion.simulate.signed_distance import locator, signed_distances, surface_points


def test_distance_to_a_ball_is_that_of_its_radius():
    body, origin = locator(sphere(4.0, level=5))
    points = np.random.default_rng(0).uniform(-3, 3, (1000, 3))
    np.testing.assert_allclose(signed_distances(body, points - origin), np.linalg.norm(points, axis=1) - 2.0, atol=0.01)


def test_distance_to_a_cube_is_that_to_the_face_in_the_point_s_direction():
    body, origin = locator(polyhedron(CUBE_CORNERS + 0.5))
    points = np.random.default_rng(1).uniform(-2, 2, (1000, 3))
    np.testing.assert_allclose(origin, 0.5)
    np.testing.assert_allclose(signed_distances(body, points), np.abs(points).max(axis=1) - 1.0, atol=1e-12)


def test_surface_points_have_no_distance():
    body, _ = locator(stone(3, 2.5, level=3))
    points = surface_points(body, icosphere(3)[0])
    np.testing.assert_allclose(signed_distances(body, points), 0, atol=1e-12)
    assert np.linalg.norm(points, axis=1).max() <= body.radius * (1 + 1e-12)


def test_an_ellipsoid_lies_inside_its_mesh():
    ellipsoid = Ellipsoid(np.array([1.0, 2.0, 3.0]), np.array([1.0, 1.5, 2.0]), np.eye(3))
    body, origin = locator(ellipsoid)
    np.testing.assert_array_equal(origin, ellipsoid.center)
    assert signed_distances(body, icosphere(4)[0] * ellipsoid.semi_axes).max() <= 1e-12
