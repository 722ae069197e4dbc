"""Soft grains: strains measured beside the motions, against the simulator that knows no voxels."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

import few_grains
from grainmotion.model.geometry import Geometry
from grainmotion.model.grains import GrainSet
from grainmotion.model.motions import Motions
from grainmotion.model.pose import Pose
from grainmotion.model.scan import Scan
from grainmotion.model.strain import components, polar_decomposition, stretches, tensors
from grainmotion.model.volume import Volume
from grainmotion.projection.grain_arrays import GrainArrays
from grainmotion.reconstruction.reconstruct import reconstruct
from grainmotion.rotations import apply_motion, rotation_matrix, rotation_vector
from grainmotion.segmentation.extraction import grains_from_labels
from grainmotion.simulate import (
    PackingSettings,
    Particle,
    Physics,
    Sample,
    label_volume,
    pack,
    record_line_integrals,
    stone,
)
from grainmotion.tracking.settings import TrackSettings
from grainmotion.tracking.strain_stages import strains_by_rotations
from grainmotion.tracking.track import track

COUNT, SEED, VOXEL = 7, 3, 0.125
PANEL, DISTANCES = (56, 56), {"source_to_axis": 120.0, "source_to_detector": 480.0}


@cache
def sample() -> Sample:
    """Stones of about 14 voxels."""
    shapes = [stone(k, 14 * VOXEL, 4) for k in range(COUNT)]
    packed = pack([Particle(shape, 0.15) for shape in shapes], PackingSettings(20 * VOXEL), SEED)
    heights = [p.center[2] for p in packed.particles]
    middle = (min(heights) + max(heights)) / 2
    return Sample(tuple(p.moved(np.eye(3), (0, 0, -middle)) for p in packed.particles))


def radiographs(of: Sample, angles, seed: int) -> Scan:
    """With the noise of 60,000 photons a pixel."""
    geometry = Geometry.cone(tuple(angles), PANEL, 4 * VOXEL, **DISTANCES)
    return record_line_integrals(of, geometry, Physics(photons=60_000), seed)


@cache
def reference() -> GrainSet:
    grid = Volume.zeros((PANEL[0], PANEL[1], PANEL[1]), VOXEL)
    volume = reconstruct(radiographs(sample(), np.arange(60) * 6.0, 0), grid).volume
    return grains_from_labels(volume, label_volume(sample(), grid))


@cache
def deformed(largest: float) -> tuple[Scan, np.ndarray, np.ndarray, np.ndarray]:
    """Radiographs of grains that moved and are strained by up to ``largest``; F ``(n, 3, 3)``, u and c ``(n, 3)``."""
    rng, particles = np.random.default_rng(SEED), sample().particles
    e = rng.normal(size=(COUNT, 3, 3))
    e = e + np.swapaxes(e, 1, 2)
    e *= largest / np.abs(np.linalg.eigvalsh(e)).max(axis=1)[:, None, None]
    gradients = rotation_matrix(np.radians(rng.uniform(-4, 4, (COUNT, 3)))) @ stretches(components(e))
    shifts, centers = rng.uniform(-VOXEL, VOXEL, (COUNT, 3)), np.array([p.center for p in particles])
    moved = [p.moved(f, u + c - f @ c) for p, f, u, c in zip(particles, gradients, shifts, centers, strict=True)]
    dense = [replace(p, attenuation=p.attenuation / np.linalg.det(f)) for p, f in zip(moved, gradients, strict=True)]
    return radiographs(Sample(tuple(dense)), (0.0, 45.0, 90.0, 135.0), 1), gradients, shifts, centers


def errors(measured: Motions, gradients, shifts, centers):
    """Errors of u (voxels), of the rotation (degrees) and of the strains, and all of them over their sd."""
    rotations, strains = polar_decomposition(gradients)
    u = measured.translations - (apply_motion(gradients, shifts, centers, measured.centers) - measured.centers)
    w = rotation_vector(measured.matrices @ np.swapaxes(rotations, 1, 2))
    e = measured.strains - strains
    sd = np.sqrt(np.diagonal(measured.covariances, axis1=1, axis2=2))
    return u / VOXEL, np.degrees(w), e, np.hstack([np.hstack([u, w]) / sd, e / measured.strain_sd])


def rms(x):
    return float(np.sqrt(np.mean(np.square(x))))


class TestSoftGrains:
    @pytest.mark.parametrize("largest", [0.05, 1e-6], ids=["strained", "rigid"])
    def test_strains_and_motions_are_found_within_their_standard_deviations(self, largest):
        scan, *truth = deformed(largest)
        measured = track(reference(), scan, settings=TrackSettings(strain=True))
        u, w, e, ratios = errors(measured, *truth)
        assert measured.ok.all()
        assert rms(u) < 0.03
        assert rms(w) < 0.43  # as 0.3 of grains of 20 voxels
        assert rms(e) < 0.004
        assert rms(ratios) < 1.25
        assert (np.abs(ratios) < 1.96).mean() > 0.9

    def test_strains_of_the_state_before_are_a_start(self):
        """It ends at the same strains, and needs no search from rigid grains."""
        scan, *truth = deformed(0.05)
        first = track(reference(), scan, settings=TrackSettings(strain=True))
        again = track(reference(), scan, first, TrackSettings(strain=True, fields=False, filters=(0.7,)))
        np.testing.assert_allclose(again.strains, first.strains, atol=1e-3)
        assert rms(errors(again, *truth)[2]) < 0.006


class TestRigidGrains:
    def test_no_strain_is_measured_unless_asked(self):
        grains = few_grains.grain_set(2)
        measured = track(
            grains,
            few_grains.radiographs(grains, few_grains.small_motions(grains)),
            settings=TrackSettings(search=False),
        )
        assert measured.strains is None
        assert measured.strain_sd is None
        np.testing.assert_array_equal(measured.gradients, measured.matrices)

    def test_motions_of_some_grains_keep_their_strains(self):
        grains = few_grains.grain_set(2)
        still = Motions.identity(grains.labels, grains.centers)
        strained = replace(still, strains=np.full((2, 6), 0.01), strain_covariances=np.zeros((2, 6, 6)))
        other = strained.for_grains(np.array([2, 9]), np.zeros((2, 3)))
        np.testing.assert_array_equal(other.strains[0], 0.01)
        assert np.isnan(other.strains[1]).all()
        np.testing.assert_array_equal(other.stretches[1], np.eye(3))


def test_strains_of_a_grain_whose_rotation_is_unknown_turn_with_it():
    """The covariance is that of many rotations of the same shape in the sample."""
    grains = GrainArrays.of(few_grains.grain_set(1))
    strain, start = np.array([[0.05, -0.02, 0.01, 0.03, 0.0, -0.04]]), rotation_matrix([[0.4, -0.8, 1.1]])
    pose = Pose(np.zeros((1, 3)), start)
    rng = np.random.default_rng(0)
    spread = np.diag([1e-3, 3e-3, 2e-3])
    turned = rotation_matrix(rng.standard_normal((4000, 3)) @ spread) @ start
    shape = start @ tensors(strain) @ np.swapaxes(start, 1, 2)
    expected = np.cov(components(np.swapaxes(turned, 1, 2) @ shape @ turned).T)
    found = strains_by_rotations((spread**2)[None], grains.stretched(stretches(strain)), pose)[0]
    np.testing.assert_allclose(found, expected, atol=0.06 * np.abs(expected).max())
    assert not strains_by_rotations((spread**2)[None], grains, pose).any()
