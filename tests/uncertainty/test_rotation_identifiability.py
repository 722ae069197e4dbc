"""Identifiability of rotations (`uncertainty.rotation_identifiability`); physical balls are tested in `physics/`."""

from dataclasses import replace

import numpy as np
import pytest

from few_grains import GAIN_AND_OFFSET, VOXEL, geometry, grain_set, motions, radiographs, small_motions
from grainmotion.model.grains import GrainSet
from grainmotion.model.pose import NuisanceMotion, Pose, ViewCorrections
from grainmotion.objective.data_term import Target
from grainmotion.objective.nuisance_motions import corrected_geometry
from grainmotion.objective.residual import StateProblem
from grainmotion.projection.footprints import footprint_patches
from grainmotion.projection.grain_arrays import GrainArrays
from grainmotion.rotations import rotation_matrix
from grainmotion.uncertainty.rotation_identifiability import (
    UNIFORM_ANGLE_VARIANCE,
    _with_rotated_hulls,
    shifts_by_rotations,
    unconfirmed_rotations,
)


def unconfirmed_covariances(grains, truth, scan, valid=None):
    """Covariances of unconfirmed rotations at the true pose."""
    target = Target(scan, np.zeros(scan.line_integrals.shape, np.float32), "trilinear", 0.7, GAIN_AND_OFFSET)
    problem = StateProblem(GrainArrays.of(grains, fine=True), target)
    pose = Pose(truth.translations, truth.matrices)
    return unconfirmed_rotations(problem, pose, problem.evaluate_with_derivatives(pose))


def with_pattern(grains, share, seed=0):
    """The grains with white noise in their voxels and without finer voxels."""
    rng = np.random.default_rng(seed)
    with_noise = []
    for g in grains.grains:
        pattern = share * rng.standard_normal(g.volume.shape) * (g.volume.array > 0)
        array = (g.volume.array + pattern).astype(np.float32)
        with_noise.append(replace(g, volume=replace(g.volume, array=array), fine=None))
    return GrainSet(tuple(with_noise))


def smooth_among_others():
    """Grains of which the second is a ball."""
    return grain_set(sphere=2)


def truth_of_all():
    return small_motions(smooth_among_others())


class TestUnconfirmed:
    def test_rotations_of_angular_grains_are_confirmed(self):
        grains = grain_set()
        truth = small_motions(grains)
        assert not unconfirmed_covariances(grains, truth, radiographs(grains, truth)).any()

    def test_a_pattern_only_in_the_reference_does_not_confirm_rotations(self):
        """The voxels of a ball have noise that is not in the radiographs: no rotation of it is determined."""
        matrices = unconfirmed_covariances(
            with_pattern(smooth_among_others(), 0.3), truth_of_all(), radiographs(smooth_among_others(), truth_of_all())
        )
        np.testing.assert_allclose(matrices[1], UNIFORM_ANGLE_VARIANCE * np.eye(3), atol=1e-6)
        assert not matrices[[0, 2, 3, 4]].any()

    def test_a_texture_of_the_grain_confirms_its_rotations(self):
        """A pattern that is in the radiographs too is texture, which determines the rotation of a ball."""
        textured = with_pattern(smooth_among_others(), 0.3)
        assert not unconfirmed_covariances(textured, truth_of_all(), radiographs(textured, truth_of_all())).any()

    def test_rotations_are_confirmed_despite_noise_of_the_radiographs(self):
        grains = grain_set()
        truth = small_motions(grains)
        assert not unconfirmed_covariances(grains, truth, radiographs(grains, truth, noise=0.1)).any()

    def test_rotations_are_confirmed_despite_a_drift_of_gain(self):
        grains = grain_set()
        truth = small_motions(grains)
        assert not unconfirmed_covariances(grains, truth, radiographs(grains, truth, gain=1.2, offset=0.05)).any()

    def test_covariances_are_finite_for_invisible_grains(self):
        truth = replace(truth_of_all(), translations=truth_of_all().translations.copy())
        truth.translations[0] = 0, 0, 50
        matrices = unconfirmed_covariances(smooth_among_others(), truth, radiographs(smooth_among_others(), truth))
        assert np.isfinite(matrices).all()

    def test_corrected_views_are_used(self):
        """Rotations are tested on the corrected views of the pose; those of a ball are undetermined there too."""
        with_noise = with_pattern(smooth_among_others(), 0.3)
        at = NuisanceMotion(
            ViewCorrections.of(np.tile([5.0, -4.0, 0.05], (4, 1))), np.zeros((0, 3)), np.zeros((0, 3, 3))
        )
        scan = replace(
            radiographs(smooth_among_others(), truth_of_all(), views=corrected_geometry(geometry(), at)),
            geometry=geometry(),
        )
        target = Target(scan, np.zeros(scan.line_integrals.shape, np.float32), "trilinear", 0.7, GAIN_AND_OFFSET)
        problem = StateProblem(GrainArrays.of(with_noise, fine=True), target)
        pose = Pose(truth_of_all().translations, truth_of_all().matrices, at)
        matrices = unconfirmed_rotations(problem, pose, problem.evaluate_with_derivatives(pose))
        np.testing.assert_allclose(matrices[1], UNIFORM_ANGLE_VARIANCE * np.eye(3), atol=1e-6)
        assert not matrices[[0, 2, 3, 4]].any()
        rows = np.array([1, 3])
        of_some = unconfirmed_rotations(problem, pose, problem.evaluate_with_derivatives(pose), rows)
        np.testing.assert_array_equal(of_some, matrices[rows])


class TestRotatedHulls:
    @pytest.mark.parametrize("angle", [0.1, 0.5])
    def test_patches_contain_every_rotated_grain(self, angle):
        packed = GrainArrays.of(grain_set())
        pose = Pose(motions(grain_set()).translations, np.tile(np.eye(3), (5, 1, 1)))
        wide = footprint_patches(_with_rotated_hulls(packed, np.full(5, angle)), pose, geometry()).boxes
        for w in np.random.default_rng(0).normal(size=(10, 3)):
            rotations = np.tile(rotation_matrix(angle * w / np.linalg.norm(w)), (5, 1, 1))
            narrow = footprint_patches(packed, Pose(pose.translations, rotations), geometry()).boxes
            np.testing.assert_array_equal(narrow[:, :2], wide[:, :2])
            assert (wide[:, [2, 4]] <= narrow[:, [2, 4]]).all()
            assert (wide[:, [3, 5]] >= narrow[:, [3, 5]]).all()
        assert packed.voxel_size == VOXEL


def test_a_ball_whose_centre_of_mass_is_off_its_middle_is_shifted_by_unknown_rotations():
    """(R − 1) e has a variance of |e|²/3 across e."""
    e = np.array([0.1, -0.2, 0.05])
    lever = -np.cross(np.eye(3), e)  # δ × e = −[e]ₓ δ
    information = np.diag([4.0, 3.0, 5.0])
    block = np.block([[information, information @ -lever.T], [-lever @ information, 7 * np.eye(3)]])
    free = UNIFORM_ANGLE_VARIANCE * np.stack([np.eye(3), 2 * np.eye(3), np.zeros((3, 3))])
    found = shifts_by_rotations(free, np.tile(block, (3, 1, 1)))
    expected = (e @ e * np.eye(3) - np.outer(e, e)) / 3
    np.testing.assert_allclose(found, [expected, expected, np.zeros((3, 3))], atol=1e-12)
