"""Shapes (`simulate.shapes`): extents, and distances from the star point."""

import numpy as np
import pytest

from grainmotion.rotations import rotation_matrix
from grainmotion.simulate import Ellipsoid, icosphere, polyhedron, sphere
from grainmotion.simulate.shapes import CUBE_CORNERS, extent


def test_clearance_of_a_cube_is_half_its_edge():
    assert polyhedron(CUBE_CORNERS).clearance == pytest.approx(1.0)


def test_extent_of_an_ellipsoid_is_that_of_its_mesh():
    ellipsoid = Ellipsoid(np.array([0.3, -1.0, 2.0]), np.array([1.0, 2.0, 3.0]), rotation_matrix([0.4, 0.1, -0.7]))
    mesh = sphere(2.0, level=5).moved(ellipsoid.axes * ellipsoid.semi_axes, ellipsoid.center)
    directions = icosphere(1)[0]
    np.testing.assert_allclose(extent(ellipsoid, directions), extent(mesh, directions), atol=5e-3)
