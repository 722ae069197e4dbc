"""Voxelisation (`simulate.voxelise`): points inside shapes, labels and attenuation on a grid."""

import numpy as np
import pytest

from grainmotion.model.volume import Volume
from grainmotion.simulate import attenuation_volume, inside, label_volume, polyhedron, sphere, stone, stone_radius


def test_inside_a_mesh_agrees_with_the_analytic_ball_and_box():
    points = np.random.default_rng(2).uniform(-3, 3, (20_000, 3))
    r = np.linalg.norm(points, axis=1)
    is_inside = inside(sphere(4.0, level=4), points)
    assert not is_inside[r > 2.0].any()
    assert is_inside[r < 2.0 * (1 - 1.3e-3)].all()
    box = polyhedron(np.array(np.meshgrid([-1, 2], [-2, 1], [-0.5, 0.5])).reshape(3, -1).T)
    expected = ((points > [-1, -2, -0.5]) & (points < [2, 1, 0.5])).all(axis=1)
    assert np.array_equal(inside(box, points), expected)


def test_inside_a_stone_agrees_with_its_radius():
    mesh = stone(20, level=5)
    raw = np.random.default_rng(3).normal(size=(5000, 3)) * 8
    r = np.linalg.norm(raw, axis=1)
    surface = stone_radius(20, raw / r[:, None])
    is_inside = inside(mesh, raw - (0 - mesh.star_point))
    away_from_surface = np.abs(r - surface) > 0.05
    assert np.array_equal(is_inside[away_from_surface], (r < surface)[away_from_surface])


def test_attenuation_volume_has_the_sample_s_mass(case):
    volume = attenuation_volume(case.sample, case.scanner.grid, samples=2)
    mass = sum(p.mass for p in case.sample.particles)
    assert volume.array.sum(dtype=float) * volume.voxel_size**3 == pytest.approx(mass, rel=2e-3)


def test_labels_fill_the_grains_volumes(heap):
    _, sample = heap
    grid = Volume.zeros((90, 48, 48), 0.25)
    labels = label_volume(sample, grid)
    for label, particle in zip(sample.labels, sample.particles, strict=True):
        assert (labels == label).sum() * 0.25**3 == pytest.approx(particle.shape.volume, rel=0.03)
