"""Point location in a star-shaped mesh: surface points in any direction, and the sign of distances."""

from functools import cache

import numpy as np

from grainmotion.kernels import star_mesh
from grainmotion.simulate import polyhedron
from grainmotion.simulate.shapes import CUBE_CORNERS
from grainmotion.simulate.signed_distance import locator

DIRECTIONS = np.random.default_rng(0).normal(size=(500, 3))


@cache
def tables():
    """Of a cube of half edge 1."""
    cube, _ = locator(polyhedron(CUBE_CORNERS))
    return cube.vertices, cube.faces, cube.planes, cube.across, cube.start


def test_directions_are_spread_over_the_cells_of_the_map():
    cells = {star_mesh.cell(*d) for d in DIRECTIONS}
    assert len(cells) > 400
    assert all(0 <= k < star_mesh.MAP_CELLS for pair in cells for k in pair)
    assert star_mesh.cell(*(5 * DIRECTIONS[0])) == star_mesh.cell(*DIRECTIONS[0])


def test_surface_points_of_a_cube():
    out = np.empty(DIRECTIONS.shape)
    star_mesh.hits(DIRECTIONS, *tables(), out)
    np.testing.assert_allclose(out, DIRECTIONS / np.abs(DIRECTIONS).max(axis=1, keepdims=True), atol=1e-12)


def test_distances_to_the_face_in_the_direction_of_a_point():
    out = np.empty(len(DIRECTIONS))
    star_mesh.distances(DIRECTIONS, *tables(), out)
    np.testing.assert_allclose(out, np.abs(DIRECTIONS).max(axis=1) - 1, atol=1e-12)
