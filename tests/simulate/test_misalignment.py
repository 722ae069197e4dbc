"""Misalignment (`simulate.misalignment`): true views of a misaligned panel or stage."""

import numpy as np
import pytest

from grainmotion.errors import InputError
from grainmotion.simulate import misaligned
from grainmotion.simulate.scenarios import SMALL_SCALE

GEOMETRY = SMALL_SCALE.scanner.geometry((30.0, 90.0))


def test_excess_rotation_of_the_stage_is_a_greater_angle():
    rotated = misaligned(GEOMETRY, stage_deg=[1.0, 2.0])
    np.testing.assert_allclose(rotated.vectors, SMALL_SCALE.scanner.geometry((31.0, 92.0)).vectors, atol=1e-9)


def test_shift_is_along_the_panel_s_own_axes():
    shifted = misaligned(GEOMETRY, shift_pixels=(3, -2))
    np.testing.assert_allclose(shifted.vectors, GEOMETRY.window((-2, 3), GEOMETRY.shape).vectors, atol=1e-9)


def test_numbers_for_another_count_of_views_are_refused():
    with pytest.raises(InputError, match="2 views"):
        misaligned(GEOMETRY, turn_deg=[1.0, 2.0, 3.0])
