"""Absent stones of a crowd, simulated without voxels: named, and as if they had never been there for all others."""

import numpy as np
import pytest
from validation.benchmarks.crowd import VOXEL, crowd

from grainmotion.model.motions import Status
from grainmotion.rotations import recenter
from grainmotion.tracking.track import track

NUMBER, ABSENT = 150, (40, 101)


def error(found, truth, rows):
    """Root mean square of the translations of some stones, voxels."""
    shifts = recenter(truth.matrices, truth.translations, truth.centers, found.centers)
    return float(np.sqrt(np.mean((found.translations - shifts)[rows] ** 2))) / VOXEL


@pytest.mark.slow
def test_absent_stones_are_named_and_cost_the_others_nothing():
    whole, fewer = crowd(NUMBER), crowd(NUMBER, absent=ABSENT)
    others = np.delete(np.arange(NUMBER), ABSENT)
    found = track(fewer.grains, fewer.scan)
    assert (found.statuses[list(ABSENT)] == Status.ABSENT.value).all(), found.reasons
    assert found.ok[others].all()
    reference = error(track(whole.grains, whole.scan), whole.truth, others)
    assert error(found, fewer.truth, others) < 1.1 * reference < 0.03
