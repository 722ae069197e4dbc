"""Projection of meshes: triangles that share an edge share no sample, and chords of a cylinder."""

import numpy as np
import pytest

from grainmotion.kernels import mesh_projection

HEXAGON = np.array([[6.0, 1.0], [11.0, 4.0], [11.0, 9.0], [6.0, 12.0], [1.0, 9.0], [1.0, 4.0]])  # (column, row)


def fan(depth, image, weight):
    """Add a hexagon at one depth, as six triangles around a point off its centre."""
    points = np.vstack([[5.3, 6.7], HEXAGON])
    q = np.column_stack([points, np.full(len(points), depth)])
    for k in range(6):
        mesh_projection._add_triangle(image, q, points, 0, 1 + k, 1 + (k + 1) % 6, weight, False, 1)


def test_sample_on_a_shared_edge_belongs_to_one_triangle():
    image = np.zeros((14, 13))
    fan(1.0, image, 1.0)
    assert set(np.unique(np.abs(image))) == {0.0, 1.0}
    assert np.unique(image[image != 0]).size == 1
    assert np.abs(image).sum() == pytest.approx(80, abs=7)  # the hexagon's area, in samples


def test_crossing_of_an_edge_does_not_depend_on_its_direction():
    for xa, ya, xb, yb in np.random.default_rng(0).uniform(-9, 9, (500, 4)):
        row = (ya + yb) / 2
        crossing, reversed_crossing = (
            mesh_projection._crossing(xa, ya, xb, yb, row),
            mesh_projection._crossing(xb, yb, xa, ya, row),
        )
        assert crossing == reversed_crossing


def test_path_between_two_faces_is_their_distance():
    image = np.zeros((14, 13))
    fan(1.5, image, 1.0)
    covered = image != 0
    fan(4.0, image, -1.0)
    np.testing.assert_allclose(np.abs(image), np.where(covered, 2.5, 0.0), atol=1e-12)


@pytest.mark.parametrize("distance", [0.0, 1.2, 1.9])
def test_interval_of_a_ray_in_a_cylinder(distance):
    """A ray of direction (0, 2, 0) through a cylinder of radius 2 about z."""
    interval = mesh_projection._interval(np.array([distance, -10.0, 0.5]), np.array([0.0, 2.0, 0.0]), 2.0, -1.0, 1.0)
    half = np.sqrt(4 - distance**2)
    np.testing.assert_allclose(interval, [(10 - half) / 2, (10 + half) / 2])


@pytest.mark.parametrize(("beside", "height"), [(2.1, 0.5), (0.0, 1.5)], ids=["beside", "above"])
def test_ray_that_misses_the_cylinder(beside, height):
    o, d = np.array([beside, -10.0, height]), np.array([0.0, 2.0, 0.0])
    assert mesh_projection._interval(o, d, 2.0, -1.0, 1.0) == (0.0, 0.0)
