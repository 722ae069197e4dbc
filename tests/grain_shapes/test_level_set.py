"""Signed distances on a grid against closed forms, their signs included."""

import numpy as np
import pytest
from test_mass_properties import BOX

from grainmotion.errors import InputError
from grainmotion.grain_shapes.level_set import level_set, surface_nodes
from grainmotion.grain_shapes.surface import grain_surface
from grainmotion.grain_shapes.triangle_mesh import Surface
from grainmotion.simulate.polyhedra import icosphere
from known_solids import H, box, grain, torus, voxels


def test_a_box_of_twelve_triangles():
    field = level_set(BOX, 0.1)
    q = np.abs(field.points - [1.5, 1, 0.5]) - [1.5, 1, 0.5]
    exact = np.linalg.norm(np.maximum(q, 0), axis=-1) + np.minimum(q.max(axis=-1), 0)
    np.testing.assert_allclose(field.values, exact, atol=0.02)  # far away: to a fifth of the spacing
    near = np.abs(exact) < 0.25
    np.testing.assert_allclose(field.values[near], exact[near], atol=1e-12)


def test_places_are_x_y_z_of_an_array_z_y_x():
    """A ball far from the origin, in a grid with three different numbers of points."""
    directions, faces = icosphere(4)
    stretched = Surface(directions * [1.0, 0.6, 0.4] + [5, -3, 2], faces)
    field = level_set(stretched, 0.1, margin=2)
    assert field.values.shape == tuple(sorted(field.values.shape))  # z shortest, x longest
    lowest = np.unravel_index(field.values.argmin(), field.values.shape)
    np.testing.assert_allclose(field.points[lowest], [5, -3, 2], atol=0.12)
    assert field.values.min() == pytest.approx(-0.4, abs=0.03)
    np.testing.assert_allclose(field.origin, [5 - 1.2, -3 - 0.8, 2 - 0.6], atol=0.06)


@pytest.mark.parametrize("solid", [torus(1.2, 0.5), box(3.0, 2.4, 2.0)], ids=["torus", "turned box"])
def test_grains_from_voxels(solid):
    """Negative inside, positive outside and in the hole of the torus; within 0.4 voxel of the truth."""
    field = level_set(grain_surface(grain(voxels(solid))), H)
    exact = solid.there(field.points)
    assert (np.sign(field.values) == np.sign(exact))[np.abs(exact) > 0.3 * H].all()
    gap = np.abs(field.values - exact) / H
    assert np.quantile(gap[np.abs(exact) < 3 * H], 0.99) < 0.4
    assert gap.max() < 1  # at the axes of edges, which are rounded
    volume = (np.clip(0.5 - field.values / H, 0, 1)).sum() * H**3
    assert volume == pytest.approx(solid.volume, rel=0.01)


def test_the_margin_is_kept_and_values_are_positive_there():
    field = level_set(BOX, 0.1, margin=4)
    border = np.ones(field.values.shape, dtype=bool)
    border[1:-1, 1:-1, 1:-1] = False
    assert field.values[border].min() >= 0.4 - 0.02


def test_nodes_are_spread_vertices_of_the_surface():
    directions, faces = icosphere(5)
    nodes = surface_nodes(Surface(directions, faces), 0.2)
    np.testing.assert_allclose(np.linalg.norm(nodes, axis=1), 1)
    assert 300 < len(nodes) < 800  # 4 π / 0.04 = 314 squares


def test_wrong_numbers_are_named():
    with pytest.raises(InputError, match="spacing"):
        level_set(BOX, 0.0)
    with pytest.raises(InputError, match="spacing"):
        level_set(BOX, float("nan"))
    with pytest.raises(InputError, match="points"):
        level_set(BOX, 1e-4)
    with pytest.raises(InputError, match="margin"):
        level_set(BOX, 0.1, margin=0)
    with pytest.raises(InputError, match="surface"):
        level_set(np.zeros((4, 3)), 0.1)
