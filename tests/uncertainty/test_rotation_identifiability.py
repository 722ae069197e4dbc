"""Turns that radiographs confirm, and turns that only the reference's voxels tell of; balls are in `physics/`."""

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
    unconfirmed_rotations,
)


def nuisance(grains, truth, scan, valid=None):
    """Covariances of unconfirmed turns at the truth."""
    target = Target(scan, np.zeros(scan.line_integrals.shape, np.float32), "trilinear", 0.7, GAIN_AND_OFFSET)
    problem = StateProblem(GrainArrays.of(grains, fine=True), target)
    pose = Pose(truth.translations, truth.matrices)
    return unconfirmed_rotations(problem, pose, problem.evaluate_with_derivatives(pose))


def with_pattern(grains, share, seed=0):
    """The grains with white noise in their voxels, which have no finer ones."""
    rng = np.random.default_rng(seed)
    rough = []
    for g in grains.grains:
        pattern = share * rng.standard_normal(g.volume.shape) * (g.volume.array > 0)
        array = (g.volume.array + pattern).astype(np.float32)
        rough.append(replace(g, volume=replace(g.volume, array=array), fine=None))
    return GrainSet(tuple(rough))


GRAINS = grain_set(sphere=2)
TRUTH = small_motions(GRAINS)


class TestUnconfirmed:
    def test_angular_grains_are_confirmed(self):
        grains = grain_set()
        truth = small_motions(grains)
        assert not nuisance(grains, truth, radiographs(grains, truth)).any()

    def test_a_pattern_of_the_reference_alone_is_not(self):
        """A ball whose voxels carry noise that the radiographs do not: all its turns are free."""
        found = nuisance(with_pattern(GRAINS, 0.3), TRUTH, radiographs(GRAINS, TRUTH))
        np.testing.assert_allclose(found[1], UNIFORM_ANGLE_VARIANCE * np.eye(3), atol=1e-6)
        assert not found[[0, 2, 3, 4]].any()

    def test_a_pattern_of_the_grain_itself_is(self):
        """The same pattern in the radiographs too is texture, and texture tells how a ball turns."""
        textured = with_pattern(GRAINS, 0.3)
        assert not nuisance(textured, TRUTH, radiographs(textured, TRUTH)).any()

    def test_noise_of_the_radiographs_does_not_matter(self):
        grains = grain_set()
        truth = small_motions(grains)
        assert not nuisance(grains, truth, radiographs(grains, truth, noise=0.1)).any()

    def test_nor_does_a_drift(self):
        grains = grain_set()
        truth = small_motions(grains)
        assert not nuisance(grains, truth, radiographs(grains, truth, gain=1.2, offset=0.05)).any()

    def test_grains_that_no_view_sees(self):
        gone = replace(TRUTH, translations=TRUTH.translations.copy())
        gone.translations[0] = 0, 0, 50
        found = nuisance(GRAINS, gone, radiographs(GRAINS, gone))
        assert np.isfinite(found).all()

    def test_nor_do_views_that_stand_elsewhere(self):
        """Where a pose says so, grains are turned on the views as they are: a ball's turns are free there too."""
        rough = with_pattern(GRAINS, 0.3)
        at = NuisanceMotion(ViewCorrections.of(np.tile([5.0, -4.0, 0.05], (4, 1))), np.zeros(3), np.eye(3))
        scan = replace(radiographs(GRAINS, TRUTH, views=corrected_geometry(geometry(), at)), geometry=geometry())
        target = Target(scan, np.zeros(scan.line_integrals.shape, np.float32), "trilinear", 0.7, GAIN_AND_OFFSET)
        problem = StateProblem(GrainArrays.of(rough, fine=True), target)
        pose = Pose(TRUTH.translations, TRUTH.matrices, at)
        found = unconfirmed_rotations(problem, pose, problem.evaluate_with_derivatives(pose))
        np.testing.assert_allclose(found[1], UNIFORM_ANGLE_VARIANCE * np.eye(3), atol=1e-6)
        assert not found[[0, 2, 3, 4]].any()


class TestSwollen:
    @pytest.mark.parametrize("angle", [0.1, 0.5])
    def test_holds_every_turned_grain(self, angle):
        packed = GrainArrays.of(grain_set())
        pose = Pose(motions(grain_set()).translations, np.tile(np.eye(3), (5, 1, 1)))
        wide = footprint_patches(_with_rotated_hulls(packed, np.full(5, angle)), pose, geometry()).boxes
        for w in np.random.default_rng(0).normal(size=(10, 3)):
            turns = np.tile(rotation_matrix(angle * w / np.linalg.norm(w)), (5, 1, 1))
            changes_and_products = footprint_patches(packed, Pose(pose.translations, turns), geometry()).boxes
            np.testing.assert_array_equal(changes_and_products[:, :2], wide[:, :2])
            assert (wide[:, [2, 4]] <= changes_and_products[:, [2, 4]]).all()
            assert (wide[:, [3, 5]] >= changes_and_products[:, [3, 5]]).all()
        assert packed.voxel_size == VOXEL
