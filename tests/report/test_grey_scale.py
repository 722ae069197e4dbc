"""Grey scales of images."""

from __future__ import annotations

import numpy as np
import pytest

from grainmotion.report.grey_scale import grey_scale


def test_grey_scale_starts_at_zero_and_covers_all_images():
    ramp = np.linspace(0.1, 2.0, 1000).reshape(1, 20, 50)
    scale = grey_scale(ramp, 2 * ramp)
    assert scale.low == 0
    assert scale.high == pytest.approx(4.0, rel=0.01)


@pytest.mark.parametrize("value", [0.0, 1.0, np.nan])
def test_constant_images_have_a_valid_scale(value):
    scale = grey_scale(np.full((1, 3, 4), value))
    assert scale.high > scale.low
