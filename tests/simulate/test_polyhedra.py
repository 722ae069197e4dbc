"""Meshes of common shapes (`simulate.polyhedra`): closed, with the volumes and centroids that they should have."""

import numpy as np
import pytest

from grainmotion.simulate import icosphere, polyhedron, random_polyhedron, stone


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
