"""Pixels of a state that see what the reference did not: known from the field of view and the smooth displacement."""

from __future__ import annotations

import numpy as np
import pytest

import few_grains
from grainmotion.model.field_of_view import FieldOfView
from grainmotion.model.geometry import Geometry
from grainmotion.model.pose import Pose
from grainmotion.projection.grain_arrays import GrainArrays
from grainmotion.tracking.unseen import MIN_UNSEEN_MARGIN, unseen_pixels

VOXEL = few_grains.VOXEL
PANEL = (40, 64)
PARALLEL = Geometry.parallel(few_grains.ANGLES, PANEL, VOXEL)
TOP_DOWN = Geometry(PARALLEL.vectors * np.r_[np.ones(9), -np.ones(3)], PANEL, "parallel")
CONE = Geometry.cone(few_grains.ANGLES, PANEL, 4 * VOXEL, source_to_axis=40, source_to_detector=160)
RADIUS = 25 * VOXEL


@pytest.fixture(scope="module")
def grains():
    return GrainArrays.of(few_grains.grain_set())


def moved(grains, *shift):
    n = len(grains)
    return Pose(np.tile(np.array(shift, float) * VOXEL, (n, 1)), np.tile(np.eye(3), (n, 1, 1)))


def masked_rows(mask):
    """Rows in which all pixels of the middle are left out, in each view."""
    return [np.flatnonzero(view[:, 25:40].all(axis=1)).tolist() for view in mask]


def test_nothing_is_left_out_of_a_whole_sample(grains):
    assert unseen_pixels(FieldOfView(CONE, RADIUS), grains, moved(grains, 0, 0, 3), CONE) is None
    beside = FieldOfView(CONE, RADIUS, beside=True)
    assert unseen_pixels(beside, grains, moved(grains, 0, 0, 3), CONE) is None


@pytest.mark.parametrize("shift", [0, -3, 5])
def test_rows_that_matter_from_above_may_enter(grains, shift):
    mask = unseen_pixels(FieldOfView(PARALLEL, RADIUS, above=True), grains, moved(grains, 0, 0, shift), PARALLEL)
    first = int(40 + shift - MIN_UNSEEN_MARGIN)
    if first >= 40:
        assert mask is None
    else:
        assert masked_rows(mask) == [list(range(first, 40))] * 4


def test_the_same_where_row_0_is_at_the_top(grains):
    mask = unseen_pixels(FieldOfView(TOP_DOWN, RADIUS, below=True), grains, moved(grains, 0, 0, 3), TOP_DOWN)
    assert masked_rows(mask) == [list(range(40 - 5, 40))] * 4


def test_both_ends_of_a_cone_beam(grains):
    mask = unseen_pixels(FieldOfView(CONE, RADIUS, above=True, below=True), grains, moved(grains, 0, 0, -2), CONE)
    for rows in masked_rows(mask):
        assert {37, 38, 39} <= set(rows) <= {0, 1, 34, 35, 36, 37, 38, 39}
        assert 20 not in rows


def test_columns_beside_the_outline_count(grains):
    slim = FieldOfView(PARALLEL, 10 * VOXEL, above=True)
    mask = unseen_pixels(slim, grains, moved(grains, 0, 0, -3), PARALLEL)
    assert mask[:, 36:, 32].all()
    assert not mask[:, :, :16].any()
    assert not mask[:, :, 48:].any()


def test_a_border_far_inside_is_not_left_out(grains):
    assert unseen_pixels(FieldOfView(PARALLEL, RADIUS, above=True), grains, moved(grains, 0, 0, -25), PARALLEL) is None


def test_a_grain_in_a_wrong_place_does_not_count(grains):
    pose = moved(grains, 0, 0, -2)
    pose.translations[0, 2] = 30 * VOXEL
    mask = unseen_pixels(FieldOfView(PARALLEL, RADIUS, above=True), grains, pose, PARALLEL)
    assert all(rows[0] in (35, 36) for rows in masked_rows(mask))
