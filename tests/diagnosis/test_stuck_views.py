"""Which neighbouring views show the same (`diagnosis.stuck_views`); whole scans are in test_frames_and_grey_values."""

import numpy as np
import pytest

from grainmotion.diagnosis.stuck_views import equal_neighbours


@pytest.mark.parametrize(
    ("ratios", "equal"),
    [
        ([1.0, 0.9, 0.2, 1.1, 1.0], [2]),
        ([1.0, 0.9, 0.2, 0.15, 1.1, 1.0], [2, 3]),
        ([0.3, 0.8, 1.1, 1.0], [0]),
        ([1.0, 1.0, 0.7, 0.25], [3]),
        ([1.0, 0.84, 0.49, 0.33, 0.56, 0.81, 1.0], []),  # rays along rows of grains, 1000 views
        ([1.0, 0.5, 0.6, 1.3], []),
    ],
)
def test_equal_views_differ_suddenly_less(ratios, equal):
    assert np.flatnonzero(equal_neighbours(np.array(ratios))).tolist() == equal
