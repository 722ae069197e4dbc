"""The next state as the last two tell it: steady motions go on, about any axis, past half a turn, and not in doubt."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from grainmotion.errors import InputError
from grainmotion.model.motions import Motions, Status
from grainmotion.sequences.extrapolation import extrapolate, rotation_steps

LABELS, CENTERS = np.array([4, 2, 9]), np.array([[1.0, 0.0, 2.0], [-1.0, 3.0, 0.0], [0.0, -2.0, 1.0]])
ABOUT_X, ABOUT_Z = np.array([np.pi / 2, 0, 0]), np.array([0, 0, np.pi / 2])


def motions(translations, rotations, status=Status.CONVERGED):
    identity = Motions.identity(LABELS, CENTERS)
    return replace(
        identity,
        translations=np.broadcast_to(np.asarray(translations, float), (3, 3)).copy(),
        rotations=np.broadcast_to(np.asarray(rotations, float), (3, 3)).copy(),
        statuses=np.full(3, status.value, dtype="<U20"),
    )


def test_equal_steps_go_on():
    expected = extrapolate(motions([1, 0, 0], [0, 0, 0.2]), motions([3, 1, 0], [0, 0, 0.5]))
    np.testing.assert_allclose(expected.translations, 3 * [[5, 2, 0]], atol=1e-12)
    np.testing.assert_allclose(expected.rotations, 3 * [[0, 0, 0.8]], atol=1e-12)
    assert set(expected.statuses) == {"not-fitted"}


def test_the_reference_is_the_state_before_the_first():
    expected = extrapolate(None, motions([0.5, 0, -1], [0.3, 0, 0]))
    np.testing.assert_allclose(expected.translations, 3 * [[1, 0, -2]], atol=1e-12)
    np.testing.assert_allclose(expected.rotations, 3 * [[0.6, 0, 0]], atol=1e-12)


def test_rotations_go_on_in_the_sample_frame():
    """A quarter turn about z, then one about the sample's x: the next is about x again, from the left."""
    second = (Rotation.from_rotvec(ABOUT_X) * Rotation.from_rotvec(ABOUT_Z)).as_rotvec()
    expected = extrapolate(motions(0, ABOUT_Z), motions(0, second)).matrices[0]
    by_hand = np.array([[0, -1, 0], [-1, 0, 0], [0, 0, -1]])  # e1 -> -e2, e2 -> -e1, e3 -> -e3
    np.testing.assert_allclose(expected, by_hand, atol=1e-12)


def test_a_rotation_past_half_a_turn_meets_no_jump():
    expected = extrapolate(motions(0, [0, 0, np.deg2rad(140)]), motions(0, [0, 0, np.deg2rad(175)]))
    np.testing.assert_allclose(np.rad2deg(expected.rotations), 3 * [[0, 0, -150]], atol=1e-9)  # 210 degrees


def test_steps_scale_with_time():
    expected = extrapolate(motions([1, 0, 0], [0, 0.1, 0]), motions([2, 0, 0], [0, 0.3, 0]), ratio=2.5)
    np.testing.assert_allclose(expected.translations, 3 * [[4.5, 0, 0]], atol=1e-12)
    np.testing.assert_allclose(expected.rotations, 3 * [[0, 0.8, 0]], atol=1e-12)


def test_only_what_is_sound_in_both_states_goes_on():
    first, second = motions([1, 0, 0], [0, 0, 0.1]), motions([2, 0, 0], [0, 0, 0.3])
    first.statuses[0] = Status.NOT_CONVERGED.value
    second.statuses[1] = Status.AMBIGUOUS.value  # its translation alone is sound
    first, second = (
        replace(m, ok_translation=np.zeros(0, bool), ok_rotation=np.zeros(0, bool)) for m in (first, second)
    )
    expected = extrapolate(first, second)
    np.testing.assert_allclose(expected.translations[:, 0], [2, 3, 3])
    np.testing.assert_allclose(expected.rotations[:, 2], [0.3, 0.3, 0.5])


def test_unknown_motions_stay_unknown():
    lost = motions(np.nan, np.nan, Status.NOT_FITTED)
    assert np.isnan(extrapolate(motions([1, 0, 0], 0), lost).translations).all()
    np.testing.assert_allclose(extrapolate(lost, motions([1, 0, 0], 0)).translations, 3 * [[1, 0, 0]])


def test_rows_are_matched_by_label_and_centres_of_another_labelling_moved():
    """The same rigid motion, told about centres that lie 1 mm higher, in another order."""
    whole = Rotation.from_rotvec([0, 0.4, 0])
    higher = CENTERS + np.array([0, 0, 1.0])
    first = motions(0, [0, 0.4, 0])
    shifted = whole.apply(higher) - higher
    first = replace(first, labels=LABELS[::-1], centers=higher[::-1], translations=shifted[::-1])
    second = motions(whole.apply(CENTERS) - CENTERS, [0, 0.4, 0])
    expected = extrapolate(first, second)  # nothing moved between the two
    np.testing.assert_allclose(expected.translations, second.translations, atol=1e-12)
    np.testing.assert_allclose(expected.rotations, second.rotations, atol=1e-12)


def test_a_ratio_that_cannot_be_is_refused():
    for ratio in (-1.0, np.nan, np.inf):
        with pytest.raises(InputError, match="ratio"):
            extrapolate(None, motions(0, 0), ratio=ratio)


def test_no_grains():
    none = Motions.identity(np.zeros(0, int), np.zeros((0, 3)))
    assert len(extrapolate(none, none)) == 0
    assert rotation_steps(np.zeros((2, 0, 3)), np.zeros((2, 0, 3))).shape == (2, 0, 3)
