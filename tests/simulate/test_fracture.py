"""A particle broken by a plane (`simulate.fracture`): closed halves, conserved volume, the same radiograph."""

import numpy as np
import pytest

from grainmotion.errors import InputError
from grainmotion.model.geometry import Geometry
from grainmotion.simulate import (
    Ellipsoid,
    Particle,
    Sample,
    broken,
    cut,
    inside,
    polyhedron,
    sphere,
    stone,
    transmission,
)

BOX = polyhedron(np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1])).reshape(3, -1).T)
MESHES = {"stone": stone(3, 2.5, level=3), "box": BOX, "sphere": sphere(2.0, level=2)}
CONE = Geometry.cone([10.0, 100.0], (48, 48), 0.25, source_to_axis=60, source_to_detector=180)


def is_closed(mesh):
    """Every edge belongs to two faces, once in each direction."""
    edges = [tuple(e) for e in np.concatenate([mesh.faces[:, [i, (i + 1) % 3]] for i in range(3)]).tolist()]
    return len(set(edges)) == len(edges) and all((b, a) in set(edges) for a, b in edges)


@pytest.mark.parametrize("normal", [(0, 0, 1), (1, 2, -3), (1, 1, 0)])  # the first and last pass through vertices
@pytest.mark.parametrize("name", MESHES)
class TestCut:
    def test_halves_are_closed_and_star_shaped(self, name, normal):
        for half in cut(MESHES[name], normal):
            assert is_closed(half)
            assert half.depth > 0

    def test_volume_and_its_centre_are_conserved(self, name, normal):
        mesh = MESHES[name]
        first, second = cut(mesh, normal)
        assert first.volume + second.volume == pytest.approx(mesh.volume, rel=1e-13)
        centre = (first.volume * first.centroid + second.volume * second.centroid) / mesh.volume
        np.testing.assert_allclose(centre, mesh.centroid, atol=1e-13)

    def test_halves_lie_on_either_side(self, name, normal):
        mesh = MESHES[name]
        first, second = cut(mesh, normal)
        assert ((first.vertices - mesh.star_point) @ normal).min() > -1e-12
        assert ((second.vertices - mesh.star_point) @ normal).max() < 1e-12

    def test_halves_in_place_have_the_radiograph_of_the_whole(self, name, normal):
        mesh = MESHES[name]
        whole = transmission(Sample((Particle(mesh, 0.1),)), CONE)
        halves = transmission(Sample(tuple(Particle(half, 0.1) for half in cut(mesh, normal))), CONE)
        np.testing.assert_allclose(halves, whole, atol=1e-10)


def test_a_half_contains_only_points_on_its_side():
    first, _ = cut(MESHES["stone"], (0.3, -0.5, 1.0))
    points = np.random.default_rng(0).uniform(-1.5, 1.5, (2000, 3))
    expected = inside(MESHES["stone"], points) & (points @ (0.3, -0.5, 1.0) > 0)
    assert np.array_equal(inside(first, points), expected)


def test_an_inclusion_stays_whole_in_its_half():
    core = Ellipsoid(np.array([0.0, 0.0, 0.4]), np.full(3, 0.2), np.eye(3))
    particle = Particle(BOX, 0.1, ((core, 0.3),))
    first, second = broken(particle, (0.0, 0.0, 1.0))
    assert len(first.inclusions) == 1
    assert second.inclusions == ()
    assert first.mass + second.mass == pytest.approx(particle.mass)
    with pytest.raises(InputError, match="crosses an inclusion"):
        broken(particle, (1.0, 0.0, 0.0))


def test_ellipsoids_and_zero_normals_are_refused():
    with pytest.raises(InputError, match="ellipsoid"):
        broken(Particle(Ellipsoid(np.zeros(3), np.ones(3), np.eye(3)), 0.1), (0, 0, 1))
    with pytest.raises(InputError, match="no direction"):
        cut(BOX, (0, 0, 0))
