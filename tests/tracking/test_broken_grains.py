"""Broken grains (`tracking.broken_grains`): cut in two, and fitted as two bodies that disturb no other grain."""

from dataclasses import replace

import numpy as np
import pytest

from few_grains import grain_set, motions, radiographs, small_motions
from grainmotion.model.motions import Status
from grainmotion.model.pose import Pose
from grainmotion.rotations import rotation_matrix
from grainmotion.tracking.broken_grains import _Cut, _halved
from grainmotion.tracking.track import track

TRUTH = small_motions(grain_set(finer=1))
NORMAL = np.array([0.6, -0.64, 0.48])


def halved(row, pose):
    return _halved(_Cut(grain_set(), pose, {}, np.arange(len(grain_set()))), row, NORMAL, 0.05)


@pytest.fixture(scope="module")
def cut():
    return halved(2, Pose(TRUTH.translations, TRUTH.matrices))


def test_halves_add_up_to_the_grain(cut):
    whole, first, second = grain_set().grains[2], *cut.grains.grains[-2:]
    np.testing.assert_allclose(first.volume.array + second.volume.array, whole.volume.array, atol=1e-6)
    np.testing.assert_allclose(first.fine.array + second.fine.array, whole.fine.array, atol=1e-6)
    masses = [float(half.volume.array.sum()) for half in (first, second)]
    middle = (masses[0] * first.center + masses[1] * second.center) / sum(masses)
    np.testing.assert_allclose(middle, whole.center, atol=0.02)
    assert (first.center - second.center) @ NORMAL > 0
    assert cut.whole == {4: 2, 5: 2}
    np.testing.assert_array_equal(cut.rows, [0, 1, 3, 4, 2, 2])


def test_halves_are_where_the_grain_was(cut):
    """Unmoved against each other, they give the radiographs of the whole."""
    told = replace(motions(cut.grains), translations=cut.pose.translations)
    matrices = cut.pose.matrices
    told = replace(told, rotations=np.vstack([TRUTH.rotations[[0, 1, 3, 4]], TRUTH.rotations[[2, 2]]]))
    np.testing.assert_allclose(rotation_matrix(told.rotations), matrices, atol=1e-9)
    whole = radiographs(grain_set(), TRUTH, noise=0.0).line_integrals
    np.testing.assert_allclose(radiographs(cut.grains, told, noise=0.0).line_integrals, whole, atol=0.02 * whole.max())


def test_a_broken_grain_disturbs_no_other(cut):
    """Halves that parted by 4 voxels and turned by 15 degrees each."""
    shifts, turns = cut.pose.translations.copy(), np.vstack([TRUTH.rotations[[0, 1, 3, 4]], TRUTH.rotations[[2, 2]]])
    shifts[4:] += np.array([1, -1])[:, None] * 0.2 * NORMAL
    turns[4:] += np.deg2rad(15) * np.array([[0.0, 0.6, 0.8], [0.8, 0.0, -0.6]])
    broken = replace(motions(cut.grains), translations=shifts, rotations=turns)
    measured = track(grain_set(), radiographs(cut.grains, broken))
    others = [0, 1, 3, 4]
    assert measured.ok[others].all(), measured.reasons
    assert np.abs(measured.translations - TRUTH.translations)[others].max() < 0.02
    assert measured.statuses[2] == Status.BROKEN.value
    assert "broken in two" in measured.reasons[2]
    assert np.isfinite(measured.translations[2]).all()
    first, second = measured.fit.pieces
    assert {first.label, second.label} == {int(grain_set().labels[2])}
    assert first.share + second.share == pytest.approx(1)
    assert first.share >= second.share
    for piece in (first, second):  # each moved as the half that it is
        k = min((4, 5), key=lambda k: np.linalg.norm(cut.grains.centers[k] - piece.center))
        arm = piece.center - cut.grains.centers[k]
        shift = shifts[k] + (rotation_matrix(turns[k]) - np.eye(3)) @ arm
        np.testing.assert_allclose(piece.translation, shift, atol=0.06)
