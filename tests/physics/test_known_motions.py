"""The small simulated case, from its full scan to motions, with radiographs by an independent projector."""

from functools import cache

import numpy as np
import pytest

from grainmotion.analysis.validation import compare
from grainmotion.model.motions import Status
from grainmotion.reconstruction.reconstruct import reconstruct
from grainmotion.rotations import rotation_matrix
from grainmotion.segmentation.extraction import grains_from_labels
from grainmotion.segmentation.segment import segment
from grainmotion.simulate import (
    LATER_ANGLES_DEG,
    Case,
    Ellipsoid,
    Particle,
    Physics,
    Sample,
    Scanner,
    label_volume,
    line_integrals,
    photons_for_snr,
    random,
    random_polyhedron,
    small,
)
from grainmotion.tracking.track import track

LIMIT_VOXEL, LIMIT_DEG = 0.1, 0.5


@cache
def case() -> Case:
    return small()


@cache
def volume():
    return reconstruct(case().reference(), case().scanner.grid).volume


@cache
def grains(segmented):
    if segmented:
        return grains_from_labels(volume(), segment(volume()).labels)
    return grains_from_labels(volume(), label_volume(case().sample, case().scanner.grid))


def tracked(name, views, segmented=False):
    truth = case().motions[name]
    scan = case().state(truth, LATER_ANGLES_DEG[views])
    measured = track(grains(segmented), scan)
    return measured, compare(measured, truth, case().scanner.voxel_size)


@pytest.mark.parametrize("views", [4, 2])
@pytest.mark.parametrize("name", ["unmoved", "shift", "random"])
def test_all_grains_are_registered(name, views):
    measured, comparison = tracked(name, views)
    assert comparison.failures == 0, measured.reasons
    assert len(comparison.spurious) == 0
    assert comparison.translation_rms_voxels <= LIMIT_VOXEL
    assert comparison.rotation_rms_deg <= LIMIT_DEG


def test_all_grains_are_registered_after_segmentation():
    measured, comparison = tracked("random", 4, segmented=True)
    assert comparison.failures == 0, measured.reasons
    assert len(comparison.spurious) == 0
    assert comparison.translation_rms_voxels <= LIMIT_VOXEL
    assert comparison.rotation_rms_deg <= LIMIT_DEG


def test_standard_deviations_are_of_the_size_of_the_errors():
    """Errors over the stated standard deviations, all states together: within a factor of 3 of one."""
    ratios = []
    for name in ("unmoved", "shift", "random"):
        measured, comparison = tracked(name, 4)
        order = comparison.matches
        sd = np.sqrt(np.diagonal(measured.covariances, axis1=1, axis2=2))[order]
        errors = np.hstack([comparison.translation_errors, np.deg2rad(comparison.rotation_errors_deg)])
        ratios.append(errors / sd)
    rms = np.sqrt(np.mean(np.concatenate(ratios) ** 2))
    assert 1 / 3 < rms < 3


def test_all_grains_are_registered_despite_a_drift_of_the_beam():
    truth = case().motions["random"]
    scan = case().state(truth, LATER_ANGLES_DEG[4])
    brighter = type(scan)(1.1 * scan.line_integrals + 0.02, scan.geometry)
    measured = track(grains(False), brighter)
    comparison = compare(measured, truth, case().scanner.voxel_size)
    assert comparison.failures == 0, measured.reasons
    assert comparison.translation_rms_voxels <= LIMIT_VOXEL
    assert measured.fit.gain == pytest.approx(1.1, abs=0.02)


@pytest.fixture(scope="module")
def tracked_round_grains():
    """A ball and a spheroid between two stones, tracked; the spheroid's axis in the reference."""
    scanner = Scanner((60, 68), 0.5, 120.0, 480.0, 90)
    d, rng = 20 * scanner.voxel_size, np.random.default_rng(3)
    stones = [random_polyhedron(rng, d, 12) for _ in range(2)]
    places = 0.55 * d * np.array([[-1, -1, -1], [1, 1, -1], [1, -1, 1], [-1, 1, 1]])
    rotation = rotation_matrix([0.3, 0.5, 0.2])
    ball = Ellipsoid(places[2], np.full(3, d / 2), np.eye(3))
    spheroid = Ellipsoid(places[3], np.array([0.55, 0.45, 0.45]) * d, rotation)
    shapes = [*(s.moved(np.eye(3), p) for s, p in zip(stones, places)), ball, spheroid]
    sample = Sample(tuple(Particle(shape, 0.1) for shape in shapes))
    paths = line_integrals(sample, scanner.geometry((0.0, 45.0)), subsamples=1)
    round_case = Case(sample, scanner, Physics(photons=photons_for_snr(paths, 50)), 0)
    reference = reconstruct(round_case.reference(), scanner.grid).volume
    grains_with_true_labels = grains_from_labels(reference, label_volume(sample, scanner.grid))
    truth = random(sample, 3 * scanner.voxel_size, 10.0, 5)
    measured = track(grains_with_true_labels, round_case.state(truth, LATER_ANGLES_DEG[4]))
    return measured, compare(measured, truth, scanner.voxel_size), rotation[:, 0]


class TestRoundGrains:
    """A ball, a spheroid and two stones: rotations that radiographs cannot determine are reported as such."""

    def test_ball_and_spheroid_are_poorly_determined_and_stones_are_not(self, tracked_round_grains):
        measured, comparison, _ = tracked_round_grains
        np.testing.assert_array_equal(comparison.matches, np.arange(4))
        assert list(measured.statuses) == [Status.CONVERGED.value] * 2 + [Status.POORLY_DETERMINED.value] * 2
        assert all("rotation about" in reason and "translation" not in reason for reason in measured.reasons[2:])

    def test_their_translations_are_right_all_the_same(self, tracked_round_grains):
        _, comparison, _ = tracked_round_grains
        assert np.abs(comparison.translation_errors).max() / comparison.voxel_size < LIMIT_VOXEL
        assert np.abs(comparison.rotation_errors_deg[:2]).max() < 2 * LIMIT_DEG

    def test_only_rotation_about_the_spheroids_axis_is_unknown(self, tracked_round_grains):
        measured, _, axis = tracked_round_grains
        rotated = measured.matrices[3] @ axis
        rotations = measured.covariances[3, 3:, 3:]
        assert np.sqrt(rotated @ rotations @ rotated) > 0.4  # radians: near the prior's
        values = np.sqrt(np.linalg.eigvalsh(rotations))
        assert np.rad2deg(values[:2]).max() < 5
        ball = np.sqrt(np.linalg.eigvalsh(measured.covariances[2, 3:, 3:]))
        assert ball.min() > 0.4
