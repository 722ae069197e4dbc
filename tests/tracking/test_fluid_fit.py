"""Grains in a liquid: motions, and attenuation and level of the later state, on the voxel-free simulator."""

import numpy as np
import pytest

import wet_sample
from grainmotion.analysis.residual_images import residual_images
from grainmotion.model.pose import Pose
from grainmotion.model.strain import stretches
from grainmotion.rotations import recenter
from grainmotion.simulate import Sample
from grainmotion.tracking.fluid_fit import FluidTracker
from grainmotion.tracking.multistage import MultistageFit
from grainmotion.tracking.settings import TrackSettings
from grainmotion.tracking.track import track
from wet_sample import LIQUID, VOXEL

LEVEL = -0.2
STONES = wet_sample.stones()


def errors(motions, truth):
    """Errors (rms) of translations (voxels) and of rotation angles (degrees), by nearest true centre."""
    nearest = [int(np.linalg.norm(truth.centers - c, axis=1).argmin()) for c in motions.centers]
    matrices = truth.matrices[nearest]
    wanted = recenter(matrices, truth.translations[nearest], truth.centers[nearest], motions.centers)
    relative = motions.matrices @ np.swapaxes(matrices, 1, 2)
    angles = np.degrees(np.arccos(np.clip((np.trace(relative, axis1=1, axis2=2) - 1) / 2, -1, 1)))
    return np.sqrt(np.mean((motions.translations - wanted) ** 2)) / VOXEL, np.sqrt(np.mean(angles**2))


@pytest.mark.parametrize(("reference_level", "level"), [(None, None), (None, LEVEL), (LEVEL, 0.4)])
def test_motions_and_level_in_a_liquid_that_drains_or_rises(reference_level, level):
    truth, later = wet_sample.moved(STONES)
    grains = wet_sample.reference(STONES, reference_level)
    scan = wet_sample.radiographs(wet_sample.in_liquid(later, LIQUID, level))
    motions = track(grains, scan)
    assert motions.ok.all()
    shift, angle = errors(motions, truth)
    assert shift < 0.06
    assert angle < 0.6
    fluid = motions.fit.fluid
    assert fluid.attenuation == pytest.approx(LIQUID, rel=0.01)
    if level is None:
        assert np.isnan(fluid.level)
    else:
        assert fluid.level == pytest.approx(level, abs=0.1 * VOXEL)
        assert 0 < fluid.level_sd < 0.2 * VOXEL
    assert np.abs(residual_images(grains, motions, scan)).max() < 0.15 * scan.line_integrals.max()


def test_another_liquid_in_the_later_state():
    truth, later = wet_sample.moved(STONES)
    motions = track(wet_sample.reference(STONES), wet_sample.radiographs(wet_sample.in_liquid(later, 0.25)))
    assert motions.ok.all()
    assert errors(motions, truth)[0] < 0.06
    assert motions.fit.fluid.attenuation == pytest.approx(0.25, rel=0.02)


def test_solid_stones_that_fall_dry_attenuate_as_stones():
    truth, later = wet_sample.moved(STONES)
    motions = track(wet_sample.reference(STONES), wet_sample.radiographs(wet_sample.solid(later, 0.0)))
    assert motions.ok.all()
    assert errors(motions, truth)[0] < 0.06
    assert motions.fit.fluid.displaced == pytest.approx(1.0, abs=0.03)
    assert motions.fit.fluid.level == pytest.approx(0.0, abs=0.1 * VOXEL)


def test_stones_that_were_taken_out_of_the_liquid_are_absent():
    truth, later = wet_sample.moved(STONES)
    left = Sample(tuple(particle for k, particle in enumerate(later.particles) if k not in (1, 3)))
    motions = track(wet_sample.reference(STONES), wet_sample.radiographs(wet_sample.in_liquid(left, LIQUID)))
    assert motions.statuses.tolist() == ["converged", "absent", "converged", "absent", "converged", "converged"]
    rows = np.flatnonzero(motions.ok)
    assert errors(motions.for_grains(motions.labels[rows], motions.centers[rows]), truth)[0] < 0.06


def test_grains_keep_their_strains_when_the_liquid_changes():
    grains, scan = wet_sample.reference(STONES), wet_sample.radiographs(wet_sample.in_liquid(STONES, LIQUID))
    fit = MultistageFit.of(grains, scan, TrackSettings(strain=True))
    fluid = FluidTracker.of(fit, grains)
    strained = stretches(np.tile([0.03, -0.02, -0.01, 0.01, 0.0, 0.0], (len(grains), 1)))
    fit.grains, fit.fine_grains = fit.grains.stretched(strained), fit.fine_grains.stretched(strained)
    fluid.place(Pose(np.zeros((len(grains), 3)), np.tile(np.eye(3), (len(grains), 1, 1))))
    np.testing.assert_array_equal(fit.grains.stretches, strained)
    np.testing.assert_array_equal(fit.fine_grains.stretches, strained)


def test_strained_stones_in_a_liquid_that_drains():
    truth, later = wet_sample.moved(STONES)
    strain = np.array([0.04, -0.03, -0.01])
    soft = tuple(p.moved(np.eye(3) + np.diag(strain), -strain * p.center) for p in later.particles)
    scan = wet_sample.radiographs(wet_sample.in_liquid(Sample(soft), LIQUID, LEVEL))
    motions = track(wet_sample.reference(STONES), scan, settings=TrackSettings(strain=True))
    assert motions.ok.all()
    assert errors(motions, truth)[0] < 0.06
    turned = np.swapaxes(motions.matrices, 1, 2) @ np.diag(strain) @ motions.matrices
    assert np.sqrt(np.mean((motions.stretches - np.eye(3) - turned) ** 2)) < 0.008
    assert motions.fit.fluid.level == pytest.approx(LEVEL, abs=0.1 * VOXEL)
