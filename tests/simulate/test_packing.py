"""Packing (`simulate.packing`): no overlap, contacts, cylinder, seed."""

import numpy as np
import pytest

from grainmotion.errors import InputError
from grainmotion.simulate import (
    PackingSettings,
    Particle,
    gaps,
    inside,
    pack,
    sphere,
)

RADIUS = 5.5  # of the heap's cylinder, mm


def test_grains_do_not_overlap_and_touch(heap):
    _, sample = heap
    distances = gaps(sample)
    assert distances.min() > 0
    touching = (distances < 0.05).sum(axis=1)
    assert (touching >= 1).all()
    assert touching.mean() >= 2


def test_no_point_is_in_two_grains(heap):
    _, sample = heap
    points = np.random.default_rng(0).uniform([-RADIUS, -RADIUS, -10], [RADIUS, RADIUS, 10], (200_000, 3))
    count = np.sum([inside(p.shape, points) for p in sample.particles], axis=0)
    assert count.max() == 1


def test_an_overlap_is_a_negative_gap(heap):
    _, sample = heap
    pushed = sample.particles[0].moved(np.eye(3), 0.2 * (sample.centers[1] - sample.centers[0]))
    pushed = type(sample)((pushed, *sample.particles[1:]))
    assert gaps(pushed).min() < 0


def test_grains_stay_in_the_cylinder(heap):
    _, sample = heap
    points = np.concatenate([p.shape.vertices for p in sample.particles if hasattr(p.shape, "vertices")])
    assert np.hypot(points[:, 0], points[:, 1]).max() <= RADIUS * (1 + 1e-9)


def test_same_seed_same_packing(heap):
    particles, _ = heap
    settings = PackingSettings(RADIUS, moves=100, sweeps=0)
    first, again, other = (pack(particles[:3], settings, seed).centers for seed in (1, 1, 2))
    assert np.array_equal(first, again)
    assert not np.allclose(first, other)


def test_narrow_cylinder_is_refused():
    with pytest.raises(InputError, match="wider cylinder"):
        pack([Particle(sphere(5.0), 0.1)], PackingSettings(2.0), seed=0)
