"""Scenes for tests: bodies beside the grains."""

import numpy as np

from grainmotion.model.scene import NO_MOTION, RIGID_MOTION, Body, Scene, first_voxel


def one_body(volume, moves=False):
    """A scene of one body of any place."""
    return Scene((Body("rest", "rest", volume, RIGID_MOTION if moves else NO_MOTION),))


def in_grid(part, whole):
    """A volume as an array on the grid of another that holds it."""
    array = np.zeros(whole.shape, part.array.dtype)
    start = first_voxel(part, whole)
    array[tuple(slice(a, a + n) for a, n in zip(start, part.shape, strict=True))] = part.array
    return array
