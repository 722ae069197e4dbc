"""Scenes for tests: bodies beside the grains."""

import numpy as np

from grainmotion.model.scene import NO_MOTION, RIGID_MOTION, Body, Scene, first_voxel
from grainmotion.model.state_fit import BodyMotion
from grainmotion.projection.bodies import packed_body
from grainmotion.projection.grains import body_image
from grainmotion.rotations import rotation_matrix


def one_body(volume, moves=False):
    """A scene of one body of any place."""
    return Scene((Body("rest", "rest", volume, RIGID_MOTION if moves else NO_MOTION),))


def packed(volume):
    """A volume as a packed body."""
    return packed_body(Body("rest", "rest", volume))


def image_of(volume, geometry, motion=(0, 0, 0, 0, 0, 0)):
    """Line integrals of a body moved by (u, ω)."""
    return body_image(
        packed(volume), np.array(motion[:3]), rotation_matrix(np.array(motion[3:])), geometry, "trilinear"
    )


def moved_body(motion, volume=None):
    """The result of a body of `one_body` that moved by (u, ω)."""
    center = np.zeros(3) if volume is None else Body("rest", "rest", volume).center
    motion = np.array(motion, dtype=float)
    moved = bool(motion.any())
    return BodyMotion("rest", "rest", "free", center, motion[:3], motion[3:], np.full((6, 6), np.nan), moved)


def in_grid(part, whole):
    """A volume as an array on the grid of another that holds it."""
    array = np.zeros(whole.shape, part.array.dtype)
    start = first_voxel(part, whole)
    array[tuple(slice(a, a + n) for a, n in zip(start, part.shape, strict=True))] = part.array
    return array
