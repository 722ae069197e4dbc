"""Sample (`simulate.sample`): particles with inclusions, and how particles and tubes move."""

import numpy as np
import pytest

from grainmotion.errors import InputError
from grainmotion.rotations import rotation_matrix
from grainmotion.simulate import (
    Ellipsoid,
    Particle,
    Sample,
    ellipsoid_particle,
    icosphere,
    inscribed,
    inside,
    sphere,
    stone,
    unmoved,
)


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


def test_inclusions_stay_inside_and_weigh_in_the_centre():
    rng = np.random.default_rng(4)
    for _ in range(20):
        particle = ellipsoid_particle(rng, 5.0, 0.1, inclusion_attenuation=0.5)
        inner = particle.inclusions[0][0]
        assert isinstance(inner, Ellipsoid)
        surface = inner.center + (icosphere(3)[0] * inner.semi_axes) @ inner.axes.T
        assert inside(particle.shape, surface).all()
        assert particle.center @ inner.center > 0  # towards the denser inclusion


def test_an_inscribed_ellipsoid_is_inside():
    rng = np.random.default_rng(1)
    directions = sphere(2.0, level=3).vertices
    for index in range(8):
        mesh = stone(index, 2.5, level=3).moved(np.eye(3), [0.3, 0.2, 0.1])
        core = inscribed(mesh, rng)
        assert inside(mesh, core.center + (directions * core.semi_axes) @ core.axes.T).all()
        assert core.semi_axes.min() > 0.4 * mesh.clearance


def test_motions_of_another_sample_are_refused():
    places = ([0.0, 0.0, 0.0], [3.0, 0.0, 0.0])
    sample = Sample(tuple(Particle(Ellipsoid(np.array(p), np.ones(3), np.eye(3)), 0.1) for p in places))
    with pytest.raises(InputError, match="labels 1 to n"):
        Sample(sample.particles[:1]).moved(unmoved(sample))
