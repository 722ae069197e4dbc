"""Bodies beside the grains (`segmentation.bodies`, `segmentation.extraction`): pieces, their names and freedoms."""

import numpy as np
import pytest
from scipy import ndimage

from grainmotion.errors import InputError
from grainmotion.model.scene import NO_MOTION, RIGID_MOTION, Freedom
from grainmotion.model.volume import Volume
from grainmotion.segmentation.extraction import extract_grains, grains_from_labels
from grainmotion.segmentation.segment import Segmentation
from grainmotion.segmentation.settings import BodySettings, SegmentSettings

SHAPE = (56, 56, 56)
Z, Y, X = np.mgrid[:56, :56, :56] - 27.5
PISTON, WALL = 0.2, 0.03


def sample(upper=PISTON, lower=PISTON, wall=0.0, inner=20.0):
    """Eight balls of attenuation 0.1 with noise, sheets above and below them, and a tube around them."""
    array, labels = np.zeros(SHAPE), np.zeros(SHAPE, np.int32)
    for k, corner in enumerate(np.ndindex(2, 2, 2), start=1):
        center = 8.0 * (2 * np.array(corner) - 1)
        distance = np.sqrt((Z - center[0]) ** 2 + (Y - center[1]) ** 2 + (X - center[2]) ** 2)
        array += 0.1 * np.clip(7 - distance, 0, 1)
        labels[distance < 6.5] = k
    radius = np.hypot(X, Y)
    array[(Z > 16) & (Z < 22) & (radius < 18)] = upper
    array[(Z < -16) & (Z > -22) & (radius < 18)] = lower
    array[(radius > inner) & (radius < inner + 5)] = wall
    array += 0.004 * np.random.default_rng(0).standard_normal(SHAPE)
    return Volume(array, 0.5), labels


def bodies(volume, labels, **settings):
    return {b.name: b for b in grains_from_labels(volume, labels, finer=1, **settings).scene.bodies}


class TestPieces:
    def test_pistons_and_a_wall_are_named_by_place(self):
        found = bodies(*sample(wall=WALL))
        assert {name: body.kind for name, body in found.items()} == {
            "upper piston": "piston",
            "lower piston": "piston",
            "wall": "wall",
        }
        np.testing.assert_allclose(found["upper piston"].center, [0, 0, 19 * 0.5], atol=0.1)
        assert all(body.freedom == RIGID_MOTION for body in found.values())

    def test_attenuation_is_kept(self):
        volume, labels = sample(wall=WALL)
        grains = grains_from_labels(volume, labels, finer=1)
        mass = sum(float(g.volume.array.sum()) for g in grains.grains) + float(grains.background.array.sum())
        assert mass == pytest.approx(float(volume.array.sum()), rel=0.01)

    def test_touching_pieces_of_different_attenuation_are_two(self):
        """The pistons touch the wall."""
        found = bodies(*sample(wall=WALL, inner=17.0))
        assert set(found) == {"upper piston", "lower piston", "wall"}
        expected = {"upper piston": PISTON, "lower piston": PISTON, "wall": WALL}
        for name, body in found.items():
            values = body.volume.array[body.volume.array > 0.02]
            assert np.median(values) == pytest.approx(expected[name], rel=0.1)

    def test_no_piece_without_unlabelled_attenuation(self):
        assert bodies(*sample(0.0, 0.0)) == {}

    def test_a_block_beside_the_grains(self):
        volume, labels = sample(0.0, 0.0)
        array = volume.array.copy()
        array[20:40, 20:40, 50:54] = 0.15
        assert list(bodies(Volume(array, 0.5), labels)) == ["body 1"]

    def test_a_piston_keeps_its_face_where_a_grain_touches_it(self):
        volume, labels = sample(lower=0.0)
        found = bodies(volume, labels)["upper piston"].volume
        face = found.array[np.abs(found.origin[2] + 0.5 * np.arange(found.shape[0]) - 0.5 * 16.5) < 0.1]
        assert (face > PISTON / 2).sum() > 0.95 * np.pi * 18**2

    def test_half_a_piston_in_a_voxel_under_a_grain_is_the_piston(self):
        """A voxel that the piston half fills is as dense as a grain, and labelled as one."""
        volume, labels = sample(lower=0.0)
        face, inside = 44, np.hypot(X, Y)[0] < 18  # z = 16.5
        volume.array[face : face + 11, inside] = PISTON
        volume.array[face, inside] = PISTON / 2
        for k in range(5, 9):
            _, y, x = ndimage.center_of_mass(labels == k)
            labels[face][np.hypot(Y[0] - y + 27.5, X[0] - x + 27.5) < 3] = k
        found = bodies(volume, labels)["upper piston"].volume
        assert found.array.sum() == pytest.approx(10.5 * PISTON * inside.sum(), rel=0.002)


class TestSettings:
    def test_fixed_holds_for_all(self):
        assert all(body.freedom == NO_MOTION for body in bodies(*sample(), background="fixed").values())

    def test_ignored(self):
        assert bodies(*sample(), background="ignore") == {}

    def test_freedom_and_name_by_place(self):
        told = (BodySettings("ram", place="above", freedom="z"), BodySettings("base", place="below", freedom="fixed"))
        grains = extract_grains(*as_segmented(), SegmentSettings(bodies=told, finer=1))
        found = {body.name: body.freedom for body in grains.scene.bodies}
        assert found == {"ram": Freedom.of("z"), "base": NO_MOTION}

    def test_a_label_can_be_a_body(self):
        volume, segmentation = as_segmented()
        told = (BodySettings("anvil", label=3, freedom="x z"),)
        grains = extract_grains(volume, segmentation, SegmentSettings(bodies=told, finer=1, background="ignore"))
        assert 3 not in grains.labels
        assert len(grains) == 7
        (anvil,) = [body for body in grains.scene.bodies if body.name == "anvil"]
        assert anvil.freedom == Freedom.of("x z")
        assert anvil.volume.array.sum() == pytest.approx(0.1 * 4 / 3 * np.pi * 6.5**3, rel=0.05)

    def test_wrong_ones_are_refused(self):
        with pytest.raises(InputError, match="label or a place"):
            BodySettings("a")
        with pytest.raises(InputError, match="freedom"):
            BodySettings("a", label=1, freedom="up")


def as_segmented():
    volume, labels = sample()
    return volume, Segmentation.of(labels)
