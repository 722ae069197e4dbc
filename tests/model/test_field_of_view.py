"""Which points of the sample the reference scan saw."""

from __future__ import annotations

import numpy as np
import pytest

from grainmotion.errors import InputError
from grainmotion.model.field_of_view import MAX_FIELD_VIEWS, FieldOfView
from grainmotion.model.geometry import Geometry

CONE = Geometry.cone(np.arange(0, 360, 4.0), (20, 30), 1.0, source_to_axis=100, source_to_detector=200)
PARALLEL = Geometry.parallel(np.arange(0, 360, 4.0), (20, 30), 1.0)
ALL = {"above": True, "below": True, "beside": True}


def test_points_at_the_center_are_seen_by_all_views():
    assert FieldOfView(CONE, 10.0, **ALL).share([[0, 0, 0], [3, 2, 3]]).tolist() == [1, 1]


@pytest.mark.parametrize("geometry", [CONE, PARALLEL])
def test_points_beyond_the_rows_are_seen_by_none(geometry):
    field = FieldOfView(geometry, 20.0, **ALL)
    assert field.share([[0, 0, 11.0], [0, 0, -11.0]]).tolist() == [0, 0]


def test_near_the_border_a_part_of_the_views_sees_a_point():
    share = FieldOfView(CONE, 10.0, **ALL).share([[5, 0, 4.9], [5, 0, 4.6], [5, 0, 5.4], [8, 0, 0]])
    assert 0 < share[0] < 1
    assert share[1] == 1
    assert share[2] == 0
    assert 0.5 < share[3] < 1


@pytest.mark.parametrize("open_border", ["above", "below", "beside"])
def test_only_borders_at_which_the_sample_goes_on_count(open_border):
    field = FieldOfView(CONE, 10.0, **{open_border: True})
    seen = field.share([[0, 0, 11.0], [0, 0, -11.0], [20, 0, 0]])
    assert (seen < 1).tolist() == [open_border == name for name in ALL]
    assert FieldOfView(CONE, 10.0).holds_all


@pytest.mark.parametrize("geometry", [CONE, PARALLEL])
def test_half_of_the_views_see_the_border(geometry):
    field = FieldOfView(geometry, 10.0, **ALL)
    places = np.array([[0.0, 0], [5, 0], [-3, 6]])
    low, high = field.border_heights(places)
    np.testing.assert_allclose(low, -high, atol=1e-9)
    if geometry is PARALLEL:
        np.testing.assert_allclose(high, 10, atol=1e-9)
    else:
        for side in (low, high):
            inside, outside = (field.share(np.c_[places, side * factor]) for factor in (0.999, 1.001))
            assert (inside >= 0.5).all()
            assert (outside <= 0.5).all()


def test_borders_of_a_sample_that_ends_are_infinite():
    low, high = FieldOfView(CONE, 10.0, above=True).border_heights([[0.0, 0.0]])
    assert low[0] == -np.inf
    assert high[0] == pytest.approx(5)


def test_some_views_stand_for_many():
    assert len(FieldOfView(CONE, 10.0).geometry) == MAX_FIELD_VIEWS


def test_radius_is_positive():
    with pytest.raises(InputError, match="radius"):
        FieldOfView(CONE, 0.0)
