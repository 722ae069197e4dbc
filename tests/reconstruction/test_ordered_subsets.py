"""Ordered subsets: the order of views and their division into subsets."""

import numpy as np
import pytest

from grainmotion.reconstruction.ordered_subsets import subsets
from grainmotion.reconstruction.system import golden_order


@pytest.mark.parametrize("count", [1, 5, 40, 352, 1000])
def test_subsets_use_views_equally_often(count):
    """Numbers of uses of two views differ by at most one; a subset contains no view twice."""
    parts = [part for phase in subsets(count) for part, _ in phase]
    uses = np.bincount(np.concatenate(parts), minlength=count)
    assert np.ptp(uses) <= 1
    assert all(len(np.unique(part)) == len(part) for part in parts)
    if count >= 352:
        assert len(np.concatenate(parts)) == pytest.approx(count * (1 + 16 / 44), rel=0.03)


class TestGoldenOrder:
    @pytest.mark.parametrize("n", [1, 2, 3, 10, 352, 1000])
    def test_order_is_a_permutation(self, n):
        np.testing.assert_array_equal(np.sort(golden_order(n)), np.arange(n))

    def test_successive_views_are_far_apart_and_the_first_ones_cover_all_directions(self):
        order = golden_order(360)
        steps = np.abs(np.diff(order))
        steps = np.minimum(steps, 360 - steps)
        assert steps.min() > 100  # about 137°
        first = np.sort(order[:12])
        assert np.diff(first).max() < 60
