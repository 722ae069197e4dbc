"""Mass properties of closed meshes: closed forms, and how they turn and move."""

import numpy as np
import pytest

from grainmotion.errors import InputError
from grainmotion.grain_shapes.mass_properties import mass_properties
from grainmotion.grain_shapes.triangle_mesh import Surface, subdivided
from grainmotion.rotations import rotation_matrix
from grainmotion.simulate.polyhedra import icosphere

BOX = Surface(
    np.array([[x, y, z] for x in (0, 3.0) for y in (0, 2.0) for z in (0, 1.0)]),
    np.array([
        [0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1],
        [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3],
    ]),
)  # fmt: skip


def test_a_box_is_exact():
    found = mass_properties(BOX)
    assert found.volume == pytest.approx(6)
    np.testing.assert_allclose(found.center, [1.5, 1, 0.5])
    np.testing.assert_allclose(found.inertia, np.diag([0.5 * 5, 0.5 * 10, 0.5 * 13]), atol=1e-12)
    assert BOX.area == pytest.approx(22)
    np.testing.assert_allclose(BOX.normals[0], [-1, 0, 0])


def test_a_tetrahedron_with_a_product_of_inertia():
    """The corner tetrahedron of edge 1: V = 1/6, centre 1/4, ∫ x² = 1/60, ∫ x y = 1/120 about the corner."""
    corner = Surface(np.vstack([np.zeros(3), np.eye(3)]), np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]))
    found = mass_properties(corner)
    diagonal = 2 * (1 / 60 - 1 / 6 / 16)
    np.testing.assert_allclose(np.diagonal(found.inertia), diagonal)
    np.testing.assert_allclose(found.inertia[0, 1], -(1 / 120 - 1 / 6 / 16))


def test_a_sphere_converges():
    directions, faces = icosphere(5)
    found = mass_properties(Surface(2 * directions + 7, faces))
    assert found.volume == pytest.approx(4 / 3 * np.pi * 8, rel=2e-3)
    np.testing.assert_allclose(found.inertia, np.eye(3) * 0.4 * found.volume * 4, atol=0.1)
    np.testing.assert_allclose(found.center, 7)


def test_principal_axes_turn_with_the_body():
    """Axes from the body's frame to that of the mesh: a right-handed frame in which the inertia is diagonal."""
    turn = rotation_matrix([0.3, 1.1, -0.4])
    found = mass_properties(BOX.moved(turn, np.array([5.0, -3.0, 2.0])))
    axes = found.principal_axes
    assert np.linalg.det(axes) == pytest.approx(1)
    np.testing.assert_allclose(axes.T @ found.inertia @ axes, np.diag([2.5, 5, 6.5]), atol=1e-12)
    np.testing.assert_allclose(found.principal_moments, [2.5, 5, 6.5])
    np.testing.assert_allclose(np.abs(np.sum(axes[:, 0] * turn[:, 0])), 1)  # the long axis


def test_subdivision_keeps_the_solid():
    fine = subdivided(BOX, 0.4)
    assert len(fine.faces) > 1000
    np.testing.assert_allclose(mass_properties(fine).inertia, mass_properties(BOX).inertia, atol=1e-10)
    assert fine.euler_characteristic == 2


@pytest.mark.parametrize(
    ("vertices", "faces", "words"),
    [
        (BOX.vertices, BOX.faces[1:], "open"),
        (BOX.vertices, BOX.faces[:, ::-1], "inwards"),
        (BOX.vertices, np.vstack([BOX.faces[:1, ::-1], BOX.faces[1:]]), "same way"),
        (BOX.vertices, BOX.faces + 1, "index 8 of 8"),
        (BOX.vertices * np.nan, BOX.faces, "NaN"),
        (BOX.vertices, np.zeros((0, 3), int), r"\(0, 3\)"),
    ],
)
def test_meshes_that_hold_no_solid_are_refused(vertices, faces, words):
    with pytest.raises(InputError, match=words):
        Surface(vertices, faces)
