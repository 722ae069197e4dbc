"""Shapes (`simulate.shapes`): closed meshes, volumes, centroids and extents."""

import numpy as np
import pytest

from grainmotion.rotations import rotation_matrix
from grainmotion.simulate import (
    Ellipsoid,
    icosphere,
    polyhedron,
    random_polyhedron,
    sphere,
    stone,
)
from grainmotion.simulate.shapes import CUBE_CORNERS, extent


def test_icosphere_is_closed_round_and_nested():
    directions, faces = icosphere(3)
    assert directions.shape == (642, 3)
    assert np.allclose(np.linalg.norm(directions, axis=1), 1)
    edges = np.sort(faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    _, counts = np.unique(edges, axis=0, return_counts=True)
    assert (counts == 2).all()
    assert np.allclose(icosphere(4)[0][:642], directions, atol=1e-12)


@pytest.mark.parametrize("diameter", [0.5, 7.0])
def test_diameter_is_that_of_the_sphere_of_equal_volume(diameter):
    rng = np.random.default_rng(0)
    for mesh in (stone(12, diameter), random_polyhedron(rng, diameter)):
        assert mesh.volume == pytest.approx(np.pi / 6 * diameter**3)
        assert np.allclose(mesh.centroid, 0, atol=1e-9)


def test_polyhedron_volume_and_centroid_of_a_box():
    corners = np.array(np.meshgrid([0, 2], [0, 3], [0, 5])).reshape(3, -1).T
    box = polyhedron(corners)
    assert box.volume == pytest.approx(30)
    assert np.allclose(box.centroid, [1, 1.5, 2.5])


def test_clearance_of_a_cube_is_half_its_edge():
    assert polyhedron(CUBE_CORNERS).clearance == pytest.approx(1.0)


def test_extent_of_an_ellipsoid_is_that_of_its_mesh():
    ellipsoid = Ellipsoid(np.array([0.3, -1.0, 2.0]), np.array([1.0, 2.0, 3.0]), rotation_matrix([0.4, 0.1, -0.7]))
    mesh = sphere(2.0, level=5).moved(ellipsoid.axes * ellipsoid.semi_axes, ellipsoid.center)
    directions = icosphere(1)[0]
    np.testing.assert_allclose(extent(ellipsoid, directions), extent(mesh, directions), atol=5e-3)
