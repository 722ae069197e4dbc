"""Spherical harmonics: closed forms, the place of each sign, and shapes that have none."""

import numpy as np
import pytest

from grainmotion.errors import InputError
from grainmotion.grain_shapes.harmonics import harmonics, orders
from grainmotion.grain_shapes.surface import grain_surface, label_surface
from grainmotion.grain_shapes.triangle_mesh import Surface
from grainmotion.model.volume import Volume
from grainmotion.simulate.polyhedra import icosphere
from known_solids import ellipsoid, grain, torus, voxels

DIRECTIONS, FACES = icosphere(5)


def index(degree, order):
    return degree * degree + degree + order


def test_a_sphere_has_one_coefficient():
    found = harmonics(Surface(2 * DIRECTIONS + 3, FACES), 6)
    expected = np.zeros(49)
    expected[0] = 2 * np.sqrt(4 * np.pi)
    np.testing.assert_allclose(found.coefficients, expected, atol=1e-9)
    np.testing.assert_allclose(found.center, 3)
    assert found.degree == 6
    assert found.residual < 1e-9


def test_every_real_harmonic_of_degree_two_and_three_has_its_sign():
    """r = 1 + 0.1 Y with Y written in x, y, z: real orthonormal harmonics without Condon–Shortley phase."""
    x, y, z = DIRECTIONS.T
    c = np.sqrt(15 / (4 * np.pi))
    forms = {
        (2, -2): c * x * y, (2, -1): c * y * z, (2, 0): np.sqrt(5 / (16 * np.pi)) * (3 * z**2 - 1), (2, 1): c * x * z,
        (2, 2): c / 2 * (x**2 - y**2), (3, 3): np.sqrt(35 / (32 * np.pi)) * (x**3 - 3 * x * y**2),
        (3, -3): np.sqrt(35 / (32 * np.pi)) * (3 * x**2 * y - y**3),
        (3, 2): np.sqrt(105 / (16 * np.pi)) * z * (x**2 - y**2),
    }  # fmt: skip
    for (degree, order), values in forms.items():
        radius = 1 + 0.02 * values
        found = harmonics(Surface(radius[:, None] * DIRECTIONS, FACES), 4)
        expected = np.zeros(25)
        expected[0], expected[index(degree, order)] = np.sqrt(4 * np.pi), 0.02
        np.testing.assert_allclose(found.coefficients, expected, atol=4e-4)  # the centre moves a little
    degrees, m = orders(3)
    assert list(zip(degrees, m))[index(3, -3)] == (3, -3)
    assert list(zip(degrees, m))[index(2, 1)] == (2, 1)


def test_an_ellipsoid_from_voxels_is_reproduced():
    solid = ellipsoid(1.8, 1.4, 1.2)
    found = harmonics(grain_surface(grain(voxels(solid))), 8)
    places = found.center + found.radius(DIRECTIONS)[:, None] * DIRECTIONS
    assert np.abs(solid.there(places)).max() < 0.012  # 0.12 voxel
    assert found.star_shaped
    assert found.worst < 0.03


def test_more_degrees_leave_less():
    residuals = [harmonics(Surface(DIRECTIONS * [2, 1, 0.7], FACES), k).residual for k in (2, 4, 8, 12)]
    assert residuals == sorted(residuals, reverse=True)
    assert residuals[-1] < 0.1 * residuals[0]


def test_a_torus_and_a_fork_are_told_not_to_be_star_shaped():
    ring = harmonics(grain_surface(grain(voxels(torus(1.2, 0.5)))), 8)
    assert not ring.star_shaped
    assert np.isnan(ring.coefficients).all()
    bars = np.zeros((24, 44, 44))
    bars[6:18, 6:18, 6:38] = 1
    bars[6:18, 6:38, 6:18] = 1
    angle = label_surface(bars.astype(int), 1, Volume(bars, 0.1))
    assert harmonics(angle, 8).star_shaped  # all of it is seen from where its arms meet
    bars[6:18, 6:38, 28:38] = 1
    fork = harmonics(label_surface(bars.astype(int), 1, Volume(bars, 0.1)), 8)
    assert not fork.star_shaped
    assert fork.overhang > 0.05


def test_degrees_out_of_range_are_named():
    small = Surface(*icosphere(1))
    for degree in (-1, 5, 41):
        with pytest.raises(InputError, match="degree"):
            harmonics(small, degree)
