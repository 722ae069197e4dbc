"""Shapes: volumes of the real stones, closed meshes, solids that move."""

import numpy as np
import pytest

from grainmotion.errors import InputError
from grainmotion.rotations import rotation_matrix
from grainmotion.simulate import (
    Ellipsoid,
    Particle,
    ellipsoid_particle,
    icosphere,
    inside,
    polyhedron,
    random_polyhedron,
    sphere,
    stone,
    stone_radius,
)
from grainmotion.simulate.stone_shapes import read_stone_shapes

# volumes in mm³ from the source's table FDOT-57-geom.dat
VOLUMES = {
    "A-anm-00001": 3083.215147,
    "A-anm-00003": 1372.400276,
    "B-anm-00006": 2614.010153,
    "C-anm-00003": 4025.232063,
    "D-anm-00001": 1354.223554,
}


def test_all_stones_are_there():
    shapes = read_stone_shapes()
    assert len(shapes) == 95
    assert shapes.coefficients.shape == (95, 378)


@pytest.mark.parametrize("name", VOLUMES)
def test_stone_has_the_volume_of_the_source(name):
    index = read_stone_shapes().names.index(name)
    # V = ∫ r³/3 dΩ by Gauss-Legendre in cos θ and equal steps in φ
    nodes, weights = np.polynomial.legendre.leggauss(60)
    phi = np.arange(120) * 2 * np.pi / 120
    rho = np.sqrt(1 - nodes**2)
    directions = np.stack(
        [np.outer(rho, np.cos(phi)), np.outer(rho, np.sin(phi)), np.outer(nodes, np.ones(120))], axis=-1
    )
    r = stone_radius(index, directions.reshape(-1, 3)).reshape(60, 120)
    volume = (weights[:, None] * r**3 / 3).sum() * 2 * np.pi / 120
    assert volume == pytest.approx(VOLUMES[name], rel=5e-4)
    # the mesh is inscribed: a little less, and less so when finer
    assert 0 < volume / stone(index, level=4).volume - 1 < 8e-3


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


def test_rigid_motion_keeps_volume_and_carries_the_centre():
    rotation, shift = rotation_matrix([0.3, -1.0, 0.4]), np.array([3.0, -2.0, 1.0])
    rng = np.random.default_rng(1)
    for particle in (
        Particle(stone(7, 4.0), 0.1),
        ellipsoid_particle(rng, 4.0, 0.1, inclusion_attenuation=0.3),
    ):
        moved = particle.moved(rotation, shift)
        assert moved.mass == pytest.approx(particle.mass)
        assert np.allclose(moved.center, rotation @ particle.center + shift)


def test_inside_a_mesh_agrees_with_the_analytic_ball_and_box():
    points = np.random.default_rng(2).uniform(-3, 3, (20_000, 3))
    r = np.linalg.norm(points, axis=1)
    held = inside(sphere(4.0, level=4), points)
    assert not held[r > 2.0].any()
    assert held[r < 2.0 * (1 - 1.3e-3)].all()
    box = polyhedron(np.array(np.meshgrid([-1, 2], [-2, 1], [-0.5, 0.5])).reshape(3, -1).T)
    expected = ((points > [-1, -2, -0.5]) & (points < [2, 1, 0.5])).all(axis=1)
    assert np.array_equal(inside(box, points), expected)


def test_inside_a_stone_agrees_with_its_radius():
    mesh = stone(20, level=5)
    raw = np.random.default_rng(3).normal(size=(5000, 3)) * 8
    r = np.linalg.norm(raw, axis=1)
    surface = stone_radius(20, raw / r[:, None])
    held = inside(mesh, raw - (0 - mesh.star_point))
    clear = np.abs(r - surface) > 0.05
    assert np.array_equal(held[clear], (r < surface)[clear])


def test_inclusions_stay_inside_and_weigh_in_the_centre():
    rng = np.random.default_rng(4)
    for _ in range(20):
        particle = ellipsoid_particle(rng, 5.0, 0.1, inclusion_attenuation=0.5)
        inner = particle.inclusions[0][0]
        assert isinstance(inner, Ellipsoid)
        surface = inner.center + (icosphere(3)[0] * inner.semi_axes) @ inner.axes.T
        assert inside(particle.shape, surface).all()
        assert particle.center @ inner.center > 0  # towards the denser inclusion


def test_unknown_stone_is_refused():
    with pytest.raises(InputError, match="0 to 94"):
        stone(95)
