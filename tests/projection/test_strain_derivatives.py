"""Derivatives by strain beside those by motion: as rows of one Jacobian, and of a slice."""

import numpy as np

import few_grains
from grainmotion.model.geometry import Geometry
from grainmotion.model.pose import Pose
from grainmotion.model.volume import Volume
from grainmotion.projection.footprints import footprint_patches
from grainmotion.projection.grain_arrays import GrainArrays
from grainmotion.projection.grains import differentiate_in_place
from grainmotion.projection.strain_derivatives import OUT_OF_PLANE_STRAINS, differentiate_by_strain, joined
from grainmotion.segmentation.extraction import grains_from_labels

GRAINS = GrainArrays.of(few_grains.grain_set(2, finer=1))
GEOMETRY = few_grains.geometry([10.0, 75.0])
POSE = Pose(np.zeros((2, 3)), np.tile(np.eye(3), (2, 1, 1)))


def test_rows_of_strains_follow_those_of_motions():
    patches = footprint_patches(GRAINS, POSE, GEOMETRY, margin=2)
    by_motion = differentiate_in_place(GRAINS, POSE, GEOMETRY, patches, "trilinear")[1]
    by_strain = differentiate_by_strain(GRAINS, POSE, GEOMETRY, patches, "trilinear")
    both = joined(by_motion, by_strain)
    assert len(both) == 4
    x = np.random.default_rng(0).normal(size=(1, 4, 6))
    expected = by_motion.images(x[:, :2])[0] + by_strain.images(x[:, 2:])[0]
    np.testing.assert_allclose(both.images(x)[0], expected, atol=1e-5)
    y = np.random.default_rng(1).normal(size=patches.stack_shape).astype(np.float32)
    np.testing.assert_allclose(both.gradient(y), np.concatenate([by_motion.gradient(y), by_strain.gradient(y)]))


def test_a_slice_shows_no_strain_out_of_its_plane():
    array = np.zeros((1, 24, 24), np.float32)
    array[0, 6:18, 7:15] = 1
    grains = GrainArrays.of(grains_from_labels(Volume(array, 0.1), (array > 0).astype(np.int32), reach=0, finer=1))
    geometry = Geometry.parallel((0.0, 60.0), (1, 40), 0.1)
    pose = Pose(np.zeros((1, 3)), np.eye(3)[None])
    patches = footprint_patches(grains, pose, geometry)
    derivatives = differentiate_by_strain(grains, pose, geometry, patches, "trilinear").derivatives
    shown = np.abs(np.asarray(derivatives)).max(axis=1) > 0
    assert np.flatnonzero(~shown).tolist() == list(OUT_OF_PLANE_STRAINS)
