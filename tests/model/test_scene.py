"""Scenes (`model.scene`): freedoms, bodies and their sum."""

import numpy as np
import pytest

from grainmotion.errors import InputError
from grainmotion.model.scene import NO_MOTION, RIGID_MOTION, Body, Freedom, Scene
from grainmotion.model.volume import Volume


class TestFreedom:
    @pytest.mark.parametrize(
        ("text", "columns"), [("fixed", []), ("free", range(6)), ("z", [2]), ("x z wz", [0, 2, 5])]
    )
    def test_basis_of_a_text(self, text, columns):
        freedom = Freedom.of(text)
        np.testing.assert_array_equal(freedom.basis, np.eye(6)[:, list(columns)])
        assert freedom.text == text
        assert freedom.moves == bool(columns)

    def test_an_axis_of_any_direction(self):
        freedom = Freedom.of("along 0 3 4")
        np.testing.assert_allclose(freedom.basis[:, 0], [0, 0.6, 0.8, 0, 0, 0])
        np.testing.assert_allclose(Freedom.of(freedom.text).basis, freedom.basis, atol=1e-8)

    @pytest.mark.parametrize("text", ["", "up", "along", "along 0 0 0", "along a b c", "fixed z"])
    def test_unknown_texts_are_refused(self, text):
        with pytest.raises(InputError, match="freedom"):
            Freedom.of(text)

    def test_ways_must_be_independent(self):
        with pytest.raises(InputError):
            Freedom(((0, 0, 1, 0, 0, 0), (0, 0, 2, 0, 0, 0)))
        with pytest.raises(InputError):
            Freedom(((0, 0, 1),))


def block(corner, shape, value):
    """A block of voxels of 0.5 mm whose first voxel is at a corner (z, y, x) of one grid."""
    x, y, z = 0.5 * (np.array(corner[::-1]) + (np.array(shape[::-1]) - 1) / 2)
    return Volume(np.full(shape, value), 0.5, (x, y, z))


class TestScene:
    def test_bodies_add_up_on_one_grid(self):
        scene = Scene(
            (Body("a", "body", block((0, 0, 0), (2, 2, 2), 1.0)), Body("b", "body", block((1, 0, 3), (2, 2, 1), 2.0)))
        )
        whole = scene.bodies_volume
        assert whole.shape == (3, 2, 4)
        np.testing.assert_allclose(whole.origin, 0, atol=1e-9)
        np.testing.assert_array_equal(whole.array[1, 0], [1, 1, 0, 2])
        assert whole.array.sum() == 16

    def test_no_body(self):
        assert Scene().bodies_volume is None
        assert not Scene().moves

    def test_it_moves_if_a_body_may(self):
        still, moving = (Body(f.text, "body", block((0, 0, 0), (1, 1, 1), 1.0), f) for f in (NO_MOTION, RIGID_MOTION))
        assert not Scene((still,)).moves
        assert Scene((still, moving)).moves

    def test_center_is_that_of_mass(self):
        body = Body("a", "body", block((2, 0, 0), (1, 1, 4), np.array([1.0, 0, 0, 3.0])))
        np.testing.assert_allclose(body.center, [0.5 * 9 / 4, 0, 1.0])

    def test_names_and_grids_are_checked(self):
        with pytest.raises(InputError, match="name"):
            Scene((Body("a", "body", block((0, 0, 0), (1, 1, 1), 1.0)),) * 2)
        other = Volume(np.ones((1, 1, 1)), 0.5, (0.1, 0, 0))
        with pytest.raises(InputError, match="one volume"):
            Scene((Body("a", "body", block((0, 0, 0), (1, 1, 1), 1.0)), Body("b", "body", other)))
