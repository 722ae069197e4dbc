"""Parts of a reference volume (`analysis.scene_parts`): shares of the attenuation."""

import numpy as np
import pytest

from grainmotion.analysis.scene_parts import field_sentence, scene_parts
from grainmotion.model.field_of_view import FieldOfView
from grainmotion.model.fluid import Fluid
from grainmotion.model.geometry import Geometry
from grainmotion.model.scene import NO_MOTION, Body, Scene
from grainmotion.model.volume import Volume

SHAPE = (10, 8, 8)


def boxed(slices, value):
    array = np.zeros(SHAPE, np.float32)
    array[slices] = value
    return array


PISTON, GRAIN = boxed(np.s_[8:], 3.0), boxed(np.s_[2:5, 2:5, 2:5], 2.0)
LABELS = (GRAIN > 0).astype(np.int32) * 7


def volume(array):
    return Volume(array, 0.5)


def piston(freedom=NO_MOTION):
    return Body("piston", "piston", volume(PISTON).cropped(PISTON > 0), freedom)


class TestSceneParts:
    def test_dry_sample(self):
        speck = boxed(np.s_[0, 0, 0], 1.0)
        total = float((PISTON + GRAIN + speck).sum())
        parts = scene_parts(volume(PISTON + GRAIN + speck), LABELS, Scene((piston(),)), border=(7,))
        assert [p.name for p in parts] == ["grains", "piston", "no part"]
        assert [p.share for p in parts] == pytest.approx([GRAIN.sum() / total, PISTON.sum() / total, 1 / total])
        assert parts[0].detail == "1, 1 of them cut by the border of the field"
        assert parts[1].detail == "freedom: fixed"
        assert str(parts[1]) == f"piston {PISTON.sum() / total:.1%}, freedom: fixed"

    def test_a_liquid_is_what_is_left_of_its_space(self):
        space = boxed(np.s_[:8], 1.0)
        liquid = Fluid(0.5, volume(space), level=-0.5)  # rows of voxels below index 4 are filled
        array = PISTON + GRAIN
        filled = (liquid.volume.array > 0) & (GRAIN == 0)
        array[filled] = liquid.volume.array[filled]
        parts = {p.name: p for p in scene_parts(volume(array), LABELS, Scene((piston(),), liquid))}
        assert sum(p.share for p in parts.values()) == pytest.approx(1)
        assert parts["liquid"].share == pytest.approx(array[filled].sum() / array.sum())
        assert parts["liquid"].detail == "0.5 1/mm up to z = -0.5 mm"
        assert parts["grains"].share == pytest.approx(GRAIN.sum() / array.sum())
        assert parts["no part"].share == 0

    def test_an_empty_volume_has_no_parts(self):
        assert scene_parts(volume(np.zeros(SHAPE, np.float32)), np.zeros(SHAPE, np.int32), Scene()) == ()


class TestFieldSentence:
    def test_names_the_sides(self):
        geometry = Geometry.cone((0.0, 90.0), (8, 8), 1.0, source_to_axis=100.0, source_to_detector=200.0)
        field = FieldOfView(geometry, 3.0, above=True, beside=True)
        assert "above and beside" in field_sentence(Scene((), None, field))

    def test_silent_where_all_was_seen(self):
        assert field_sentence(Scene()) == ""
