"""Samples that several modules test; each is packed once."""

import numpy as np
import pytest

from grainmotion.simulate import PackingSettings, Particle, ellipsoid_particle, pack, random_polyhedron, small, stone


@pytest.fixture(scope="session")
def heap():
    """Stones, polyhedra and ellipsoids of 5 mm in a cylinder of 5.5 mm radius: the particles, and the sample."""
    rng = np.random.default_rng(5)
    particles = [Particle(stone(i, 5.0, level=3), 0.1) for i in (3, 30, 60)]
    particles += [Particle(random_polyhedron(rng, 5.0), 0.1) for _ in range(2)]
    particles += [ellipsoid_particle(rng, 5.0, 0.1, inclusion_attenuation=0.3) for _ in range(2)]
    return particles, pack(particles, PackingSettings(5.5, moves=600, sweeps=1), seed=3)


@pytest.fixture(scope="session")
def case():
    """The small case."""
    return small(seed=1)
