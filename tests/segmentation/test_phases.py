"""Samples of several phases (`segmentation.phases`): materials, liquids, pistons, walls and wires beside the grains.

Stones from the voxel-free simulator, voxelised with partial volumes, blurred by 0.7 voxel, with noise.
"""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from scipy import ndimage

from grainmotion import simulate
from grainmotion.errors import InputError
from grainmotion.model.geometry import Geometry
from grainmotion.model.volume import Volume
from grainmotion.reconstruction.reconstruct import reconstruct
from grainmotion.segmentation.phases import find_phases
from grainmotion.segmentation.segment import segment
from grainmotion.segmentation.settings import PhaseSettings, SegmentSettings

STONES, ACROSS = 8, 16  # voxels across
RADIUS = 22  # of the cylinder that holds them, voxels
SHAPE = (68, 56, 56)


@cache
def sample(seed: int, stones: int = STONES, spread: float = 0.1):
    """Stones packed in a cylinder, one voxel of length 1."""
    rng = np.random.default_rng(seed)
    sizes = ACROSS * (1 + spread * rng.uniform(-1, 1, stones))
    shapes = [simulate.stone(int(i), float(d), level=2) for i, d in zip(rng.permutation(95), sizes, strict=False)]
    return simulate.pack([simulate.Particle(s, 1.0) for s in shapes], simulate.PackingSettings(RADIUS - 1.0), seed)


def grid(stones):
    return Volume.zeros(SHAPE, 1.0, (0.0, 0.0, float(stones.centers[:, 2].mean())))


@cache
def packing(seed: int, **packed):
    """Labels of stones and the share of each voxel that they fill."""
    stones = sample(seed, **packed)
    return simulate.label_volume(stones, grid(stones)), simulate.attenuation_volume(stones, grid(stones), 3).array


def radii():
    y, x = (np.arange(n) - (n - 1) / 2 for n in SHAPE[1:])
    return np.hypot(y[:, None], x[None, :])


def scanned(seed, grains=None, around=0.0, noise=0.05, **packed):
    """Truth and volume: the attenuation of each grain, and what fills the space between them."""
    truth, share = packing(seed, **packed)
    values = np.concatenate([[0.0], np.ones(truth.max()) if grains is None else grains])
    nearest = ndimage.distance_transform_edt(truth == 0, return_distances=False, return_indices=True)
    exact = values[truth[tuple(nearest)]] * share + np.broadcast_to(around, SHAPE) * (1 - share)
    blurred = ndimage.gaussian_filter(exact, 0.7) + np.random.default_rng(seed).normal(0, noise, SHAPE)
    return truth, Volume(np.clip(blurred, 0, None).astype(np.float32), 1.0)


def dice(truth, labels):
    """Of each true grain with its best label."""
    counts = np.zeros((truth.max() + 1, labels.max() + 1))
    np.add.at(counts, (truth.ravel(), labels.ravel()), 1)
    return (2 * counts[1:, 1:] / (counts.sum(1)[1:, None] + counts.sum(0)[None, 1:])).max(axis=1)


def assert_found(truth, segmentation, least=0.9):
    assert segmentation.labels.max() == truth.max()
    assert dice(truth, segmentation.labels).min() > least


class TestMaterials:
    @pytest.mark.parametrize(("seed", "faint"), [(0, 0.25), (1, 0.4)])
    def test_faint_grains_are_found_and_dense_ones_keep_their_surfaces(self, seed, faint):
        grains = np.where(np.arange(STONES) % 2, 1.0, faint)
        truth, volume = scanned(seed, grains)
        segmentation = segment(volume)
        assert_found(truth, segmentation, least=0.85)
        found = [phase.attenuation for phase in segmentation.phases if phase.kind == "grains"]
        np.testing.assert_allclose(found, [faint, 1.0], rtol=0.05)

    def test_one_material_is_segmented_by_one_threshold(self):
        truth, volume = scanned(0)
        segmentation = segment(volume)
        assert_found(truth, segmentation, least=0.95)
        assert [phase.kind for phase in segmentation.phases] == ["air", "grains"]


class TestLiquids:
    @pytest.mark.parametrize(("seed", "liquid"), [(0, 0.15), (1, 0.4), (0, 0.7)])
    def test_a_liquid_in_all_pores(self, seed, liquid):
        truth, volume = scanned(seed, around=liquid * (radii() < RADIUS))
        segmentation = segment(volume)
        assert_found(truth, segmentation)
        assert [phase.kind for phase in segmentation.phases] == ["air", "liquid", "grains"]
        np.testing.assert_allclose(segmentation.phases[1].attenuation, liquid, rtol=0.1)

    def test_a_liquid_up_to_a_level(self):
        level = (np.arange(SHAPE[0]) < SHAPE[0] // 2)[:, None, None]
        truth, volume = scanned(0, around=0.4 * level * (radii() < RADIUS))
        assert_found(truth, segment(volume))

    def test_a_liquid_in_a_wall_of_the_grains_attenuation(self):
        r = radii()
        truth, volume = scanned(0, around=0.4 * (r < RADIUS) + 1.0 * ((r > RADIUS) & (r < RADIUS + 4)))
        segmentation = segment(volume)
        assert_found(truth, segmentation)
        assert {phase.kind for phase in segmentation.phases} == {"air", "liquid", "grains", "body"}


class TestBodies:
    @pytest.mark.parametrize("piston", [0.5, 1.0, 2.0])
    def test_pistons_are_no_grains(self, piston):
        truth, share = packing(0)
        filled = np.flatnonzero(share.any(axis=(1, 2)))
        z = np.arange(SHAPE[0])[:, None, None]
        pistons = ((z < filled[0]) & (z >= filled[0] - 6)) | ((z > filled[-1]) & (z <= filled[-1] + 6))
        truth, volume = scanned(0, around=piston * pistons * (radii() < RADIUS + 1))
        segmentation = segment(volume)
        assert_found(truth, segmentation)
        assert "body" in {phase.kind for phase in segmentation.phases}

    def test_large_and_small_grains_together_are_grains(self):
        truth, volume = scanned(0, spread=0.5)
        sizes = np.bincount(truth.ravel())[1:]
        assert sizes.max() > 15 * sizes.min()
        assert_found(truth, segment(volume))


class TestTold:
    def test_phases_that_are_told(self):
        _, volume = scanned(0, np.where(np.arange(STONES) % 2, 1.0, 0.4))
        told = (PhaseSettings("air", 0.0), PhaseSettings("body", 0.4), PhaseSettings("grains", range=(0.7, 1.3)))
        segmentation = segment(volume, SegmentSettings(phases=told))
        assert segmentation.labels.max() == STONES // 2
        assert [phase.kind for phase in segmentation.phases] == ["air", "body", "grains"]

    def test_air_need_not_be_told(self):
        truth, volume = scanned(0)
        assert_found(truth, segment(volume, SegmentSettings(phases=(PhaseSettings("grains", 1.0),))))

    @pytest.mark.parametrize("values", [{}, {"attenuation": 1.0, "range": (0.5, 1.0)}, {"range": (1.0, 0.5)}])
    def test_a_phase_needs_an_attenuation_or_a_range(self, values):
        with pytest.raises(InputError, match="PhaseSettings"):
            PhaseSettings("grains", **values)


def test_phases_around_given_labels():
    truth, volume = scanned(0, around=0.4 * (radii() < RADIUS))
    phases = find_phases(volume, truth)
    assert phases is not None
    assert [phase.kind for phase in phases.phases] == ["air", "liquid", "grains"]
    assert phases.where("liquid")[SHAPE[0] // 2][radii() < RADIUS - 2].mean() > 0.3
    assert find_phases(scanned(0)[1], truth) is None


class TestReconstructed:
    def test_two_materials_in_a_liquid_from_radiographs(self):
        packed = sample(0)
        excess = np.where(np.arange(STONES) % 2, 0.04, 0.02)  # over a liquid of 0.02/mm that fills a cylinder
        stones = simulate.Sample(
            tuple(
                simulate.Particle(p.shape, float(mu)).moved(np.eye(3), -np.array(grid(packed).center))
                for p, mu in zip(packed.particles, excess, strict=True)
            ),
            simulate.Tube(0.0, RADIUS + 1.0, 0.02),
        )
        geometry = Geometry.cone(
            tuple(np.arange(45) * 8.0), (76, 60), 2.0, source_to_axis=400.0, source_to_detector=800.0
        )
        scan = simulate.record_line_integrals(stones, geometry, simulate.Physics(photons=1e5), 0)
        volume = reconstruct(scan, Volume.zeros((76, 60, 60), 1.0)).volume
        segmentation = segment(volume)
        assert_found(simulate.label_volume(simulate.Sample(stones.particles), volume), segmentation, least=0.85)
        found = [(phase.kind, round(phase.attenuation, 3)) for phase in segmentation.phases if phase.share > 0.02]
        assert found == [("air", 0.0), ("liquid", 0.02), ("grains", 0.04), ("grains", 0.06)]
