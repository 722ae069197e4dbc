"""Projection and back-projection of whole volumes."""

import numpy as np

from grainmotion.model.volume import Volume
from grainmotion.projection.volumes import back_project, project
from three_lumps import PANEL, VOXEL, scanner


def test_back_projection_has_the_grid_of_the_given_volume():
    grid = Volume.zeros((4, 5, 6), VOXEL, (0.3, 0.2, 0.1))
    back = back_project(np.ones((2, *PANEL), np.float64), scanner(), grid)
    assert (back.shape, back.center) == ((4, 5, 6), (0.3, 0.2, 0.1))
    assert (back.array > 0).all()
    assert not grid.array.any()


def test_volume_outside_the_field_of_view_attenuates_nothing():
    volume = Volume(np.ones((4, 5, 6)), VOXEL, (0, 0, 50.0))
    assert not project(volume, scanner()).any()
