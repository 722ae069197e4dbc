"""The start of a state: the one of several that the radiographs fit best, and told with its rivals."""

import numpy as np
import pytest

from few_grains import errors, grain_set, motions, radiographs, small_motions
from grainmotion.errors import InputError
from grainmotion.tracking.track import TrackSettings, track

COARSE = grain_set(3, finer=1)  # the same centres
NEAR = motions(COARSE, [0.5, -0.3, 0.2], [0, 0, 12.0])
FAR = motions(COARSE, [-0.4, 0.4, 0.0], [0, 0, -15.0])
QUICK = TrackSettings(search=False, fields=False, alternatives=False)


@pytest.mark.parametrize("starts", [(FAR, NEAR), (NEAR, FAR), (None, NEAR), (FAR, NEAR, None)])
def test_the_start_nearest_the_truth_is_taken(starts):
    measured = track(grain_set(3), radiographs(grain_set(3), NEAR, gain=1.05, offset=0.1), starts, QUICK)
    assert starts[measured.fit.best_start] is NEAR
    assert len(measured.fit.start_residuals) == len(starts)
    assert sorted(measured.fit.start_residuals)[0] < 0.5 * sorted(measured.fit.start_residuals)[1]
    translations, rotations = errors(measured, NEAR)
    assert np.abs(translations).max() < 0.1
    assert np.abs(rotations).max() < 1.0


def test_of_equal_starts_the_first_is_taken():
    measured = track(grain_set(3), radiographs(grain_set(3), NEAR), (NEAR, NEAR), QUICK)
    assert measured.fit.best_start == 0


def test_several_starts_change_nothing_else():
    """The same motions, bit by bit, as from the start that is taken alone; which tells of no rivals."""
    truth = small_motions(grain_set(3))
    scan = radiographs(grain_set(3), truth)
    alone, of_two = track(grain_set(3), scan, None, QUICK), track(grain_set(3), scan, [None, FAR], QUICK)
    np.testing.assert_array_equal(alone.translations, of_two.translations)
    np.testing.assert_array_equal(alone.rotations, of_two.rotations)
    assert alone.fit.start_residuals == ()


def test_a_start_without_motions_is_no_motion():
    lost = motions(grain_set(3), np.nan, np.nan)
    measured = track(grain_set(3), radiographs(grain_set(3), NEAR), [lost, NEAR], QUICK)
    assert measured.fit.best_start == 1


def test_no_start_in_a_sequence_is_refused():
    with pytest.raises(InputError, match="an empty sequence"):
        track(grain_set(3), radiographs(grain_set(3), NEAR), [], QUICK)
