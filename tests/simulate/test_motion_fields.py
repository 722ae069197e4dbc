"""Prescribed motion fields (`simulate.motion_fields`): what each kind does to points."""

import numpy as np
import pytest

from grainmotion.errors import InputError
from grainmotion.model.motion_table import MOTION_COLUMNS, OK_COLUMNS, REASON_COLUMN
from grainmotion.rotations import skew_matrix
from grainmotion.simulate import Ellipsoid, Particle, Sample, affine, random, rigid, shear_band, unmoved


@pytest.fixture
def sample():
    places = np.random.default_rng(0).uniform(-10, 10, (40, 3))
    return Sample(tuple(Particle(Ellipsoid(p, np.ones(3), np.eye(3)), 0.1) for p in places))


def test_true_motions_have_the_columns_of_a_measurement(sample):
    table = random(sample, 1.0, 10.0, seed=1).to_table()
    assert tuple(table.columns) == (*MOTION_COLUMNS, REASON_COLUMN, *OK_COLUMNS)
    assert (table["status"] == "converged").all()
    assert np.allclose(table[["x", "y", "z"]], sample.centers)


def test_unmoved_sample_stays(sample):
    assert np.allclose(sample.moved(unmoved(sample)).centers, sample.centers)


def test_rigid_motion_carries_all_centres_as_one_body(sample):
    center, shift = np.array([1.0, 2.0, 3.0]), np.array([0.5, -1.0, 2.0])
    motions = rigid(sample, shift, (0, 0, 90), center)
    lever = sample.centers - center
    expected = np.stack([-lever[:, 1], lever[:, 0], lever[:, 2]], axis=1) + center + shift
    assert np.allclose(sample.moved(motions).centers, expected)
    assert np.allclose(np.rad2deg(motions.rotations), [0, 0, 90])


def test_random_motions_keep_their_limits(sample):
    motions = random(sample, 0.7, 10.0, seed=2)
    lengths = np.linalg.norm(motions.translations, axis=1)
    angles = np.rad2deg(np.linalg.norm(motions.rotations, axis=1))
    assert 0.5 < lengths.max() <= 0.7
    assert 8 < angles.max() <= 10
    assert np.array_equal(motions.translations, random(sample, 0.7, 10.0, seed=2).translations)
    assert not np.allclose(motions.translations, random(sample, 0.7, 10.0, seed=3).translations)


def test_affine_rotates_grains_with_its_skew_part(sample):
    spin = np.array([0.01, -0.02, 0.03])
    stretch = np.diag([0.1, -0.05, 0.0])
    motions = affine(sample, skew_matrix(spin) + stretch)
    assert np.allclose(motions.rotations, spin)
    assert np.allclose(motions.translations, np.cross(spin, sample.centers) + sample.centers @ stretch)


def test_shear_band_slides_two_blocks_and_rotates_the_grains_between(sample):
    motions = shear_band(sample, 2.0, 1.0, normal=(0, 0, 1), direction=(1, 0, 0))
    above = sample.centers[:, 2] > 2
    below = sample.centers[:, 2] < -2
    assert np.allclose(motions.translations[above], [1, 0, 0], atol=1e-2)
    assert np.allclose(motions.translations[below], [-1, 0, 0], atol=1e-2)
    middle = np.argmin(np.abs(sample.centers[:, 2]))
    # ½ curl of u_x(z) is along +y: the top goes to +x, as a right-handed rotation about y carries z to x
    assert motions.rotations[middle, 1] > 0.2
    assert np.allclose(motions.rotations[:, [0, 2]], 0)


def test_slip_out_of_the_plane_is_refused(sample):
    with pytest.raises(InputError, match="slip in the plane"):
        shear_band(sample, 1.0, 1.0, normal=(0, 0, 1), direction=(0, 1, 1))
