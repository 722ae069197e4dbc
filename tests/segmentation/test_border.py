"""Which labels the border of the field of view cuts."""

from __future__ import annotations

import numpy as np
import pytest

from grainmotion.model.field_of_view import FieldOfView
from grainmotion.model.geometry import Geometry
from grainmotion.model.volume import Volume
from grainmotion.segmentation.blocks import Block
from grainmotion.segmentation.border import beyond_field, border_labels, cut_labels

SHAPE = (40, 40, 40)
WHOLE = Block((0, 0, 0), SHAPE)
ANGLES = np.arange(0, 360, 7.5)
PANEL = (32, 32)  # of 40 layers and columns
GEOMETRIES = {
    "parallel": Geometry.parallel(ANGLES, PANEL, 1.0),
    "cone": Geometry.cone(ANGLES, PANEL, 2.0, source_to_axis=200, source_to_detector=400),
}


def cube(labels, label, low, high):
    labels[tuple(slice(a, b) for a, b in zip(low, high, strict=True))] = label


@pytest.fixture
def labels():
    found = np.zeros(SHAPE, np.int32)
    cube(found, 1, (30, 18, 18), (35, 23, 23))  # up to 15 of the 16 layers above the middle that are seen
    cube(found, 2, (30, 10, 10), (38, 15, 15))  # beyond them
    cube(found, 3, (2, 18, 18), (8, 23, 23))  # below
    cube(found, 4, (18, 18, 32), (23, 23, 39))  # beside
    cube(found, 5, (18, 18, 18), (23, 23, 23))  # in the middle
    return found


def field(geometry, **borders):
    return FieldOfView(geometry, 20.0, **borders)


@pytest.mark.parametrize("geometry", GEOMETRIES.values(), ids=GEOMETRIES.keys())
class TestWhatViewsSaw:
    def test_grains_beyond_the_borders_are_cut(self, labels, geometry):
        volume = Volume(np.zeros(SHAPE), 1.0, field=field(geometry, above=True, below=True, beside=True))
        assert cut_labels(labels, volume) == (2, 3, 4)

    def test_where_the_sample_ends_no_grain_is_cut(self, labels, geometry):
        volume = Volume(np.zeros(SHAPE), 1.0, field=field(geometry, above=True))
        assert cut_labels(labels, volume) == (2,)
        assert cut_labels(labels, Volume(np.zeros(SHAPE), 1.0, field=field(geometry))) == ()

    def test_faces_of_the_volume_cut_as_well(self, labels, geometry):
        volume = Volume(np.zeros((38, 40, 40)), 1.0, field=field(geometry))
        assert cut_labels(labels[:38], volume) == (2,)

    def test_a_grain_that_ends_at_the_border_with_its_full_attenuation_is_cut(self, geometry):
        """Beyond the border the volume is empty, and without labels."""
        labels = np.zeros(SHAPE, np.int32)
        cube(labels, 6, (28, 18, 18), (35, 23, 23))
        volume = Volume(0.1 * (labels > 0), 1.0, field=field(geometry, above=True))
        last = np.flatnonzero(~beyond_field(volume).of(WHOLE)[:, 20, 20])[-1]
        labels[last + 1 :] = 0
        cube(labels, 6, (28, 18, 18), (last + 1, 23, 23))
        full = 0.1 * (labels > 0)
        assert cut_labels(labels, Volume(full, 1.0, field=field(geometry, above=True))) == (6,)
        full[last] *= 0.6  # a blurred surface
        assert cut_labels(labels, Volume(full, 1.0, field=field(geometry, above=True))) == ()


def test_without_a_field_faces_and_cylinder_cut(labels):
    assert cut_labels(labels, Volume(np.zeros(SHAPE), 1.0)) == border_labels(labels) == (4,)


def test_what_was_not_seen_is_beyond_the_field():
    beyond = beyond_field(
        Volume(np.zeros(SHAPE), 1.0, field=field(GEOMETRIES["parallel"], above=True, beside=True))
    ).of(WHOLE)
    assert beyond[37, 20, 20]
    assert beyond[20, 20, 38]
    assert not beyond[[2, 20], 20, 20].any()
    assert beyond_field(Volume(np.zeros(SHAPE), 1.0, field=field(GEOMETRIES["parallel"]))) is None
    assert beyond_field(Volume(np.zeros(SHAPE), 1.0)) is None
