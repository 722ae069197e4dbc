"""Two pistons that move apart, between them grains: each piston's own motion, and the grains', on the simulator."""

from functools import cache

import numpy as np
from scipy.spatial.transform import Rotation

from grainmotion.model.geometry import Geometry
from grainmotion.model.volume import Volume
from grainmotion.segmentation.extraction import grains_from_labels
from grainmotion.simulate import (
    Particle,
    Physics,
    Sample,
    attenuation_volume,
    label_volume,
    polyhedron,
    record_line_integrals,
    stone,
)
from grainmotion.tracking.track import track

VOXEL = 0.1
GRAIN_CENTERS = VOXEL * np.array([[-8.0, -8, -8], [8, -7, -7], [-7, 8, -8], [8, 8, -7], [-8, -7, 8], [8, 7, 8]])
DOWN = np.array([0.3, -0.2, -4.6]) * VOXEL
TILT = np.deg2rad([0.8, -0.6, 0.0])


def disc(low, high, radius):
    angles = np.linspace(0, 2 * np.pi, 36, endpoint=False)
    ring = radius * np.column_stack([np.cos(angles), np.sin(angles)])
    return Particle(polyhedron(np.concatenate([np.column_stack([ring, np.full(36, z)]) for z in (low, high)])), 0.4)


@cache
def case():
    """Grains and the measured motions; the true ones of grains and pistons."""
    stones = [stone(k, 13 * VOXEL, 3) for k in range(len(GRAIN_CENTERS))]
    grains = [Particle(shape, 0.3) for shape in stones]
    grains = [p.moved(np.eye(3), c - p.center) for p, c in zip(grains, GRAIN_CENTERS, strict=True)]
    pistons = [disc(16 * VOXEL, 21 * VOXEL, 18 * VOXEL), disc(-21 * VOXEL, -16 * VOXEL, 18 * VOXEL)]
    rng = np.random.default_rng(1)
    shifts, turns = rng.normal(size=(6, 3)) * 0.6 * VOXEL, rng.normal(size=(6, 3)) * np.deg2rad(2.0)
    matrices = Rotation.from_rotvec(turns).as_matrix()
    moved = [p.moved(R, u + p.center - R @ p.center) for p, R, u in zip(grains, matrices, shifts, strict=True)]
    tilt = Rotation.from_rotvec(TILT).as_matrix()
    base, top = pistons[1], pistons[0]
    later = [top.moved(np.eye(3), -DOWN), base.moved(tilt, DOWN + base.center - tilt @ base.center)]
    grid = Volume.zeros((64, 52, 52), VOXEL)
    volume = attenuation_volume(Sample((*grains, *pistons)), grid, 4)
    labels = label_volume(Sample(tuple(grains)), grid)
    views = Geometry.cone((0.0, 50.0, 95.0, 140.0), (76, 64), 0.2, source_to_axis=60.0, source_to_detector=120.0)
    scan = record_line_integrals(Sample((*moved, *later)), views, Physics(photons=5e4), 3)
    found = grains_from_labels(volume, labels)
    return found, track(found, scan), shifts, turns


def test_each_piston_has_its_own_motion():
    _, motions, _, _ = case()
    upper, lower = motions.fit.bodies
    assert (upper.name, lower.name) == ("upper piston", "lower piston")
    assert upper.moved
    assert lower.moved
    np.testing.assert_allclose(upper.translation, -DOWN, atol=0.05 * VOXEL)
    np.testing.assert_allclose(lower.translation, DOWN, atol=0.05 * VOXEL)
    np.testing.assert_allclose(lower.rotation[:2], TILT[:2], atol=np.deg2rad(0.1))
    sd = np.sqrt(np.diag(lower.covariance))
    assert (np.abs(lower.translation - DOWN) < 3 * sd[:3]).all()
    assert sd[:3].max() < 0.15 * VOXEL  # with what voxels leave along the faces (decision 0032)
    assert np.rad2deg(sd[5]) > 90  # a disc looks the same turned about its axis


def test_grains_between_them_are_registered():
    found, motions, shifts, turns = case()
    assert motions.ok.all(), motions.reasons
    order = [int(np.linalg.norm(GRAIN_CENTERS - c, axis=1).argmin()) for c in found.centers]
    assert np.abs(motions.translations - shifts[order]).max() < 0.1 * VOXEL
    assert np.abs(motions.rotations - turns[order]).max() < np.deg2rad(2.0)
