"""Clumps of spheres: they lie inside, fill more as there are more, and their mass properties are those of the union."""

import numpy as np
import pytest

from grainmotion.errors import InputError
from grainmotion.grain_shapes.clump import clump, union_properties
from grainmotion.grain_shapes.surface import grain_surface
from known_solids import H, ellipsoid, grain, sphere, voxels


@pytest.fixture(scope="module")
def oval():
    solid = ellipsoid(1.8, 1.3, 1.0)
    return solid, grain_surface(grain(voxels(solid)))


def test_spheres_inside_fill_more_and_more(oval):
    solid, surface = oval
    found = [clump(surface, H, spheres=k, clump_fit="inside") for k in (1, 4, 16, 64)]
    errors = [c.volume_error for c in found]
    assert errors == sorted(errors)
    assert errors[0] < -0.3
    assert errors[-1] > -0.08
    for c in found:
        assert c.radii[0] == pytest.approx(1.0, abs=H)  # the largest ball in the ellipsoid
        reach = c.centers[:, None] + c.radii[:, None, None] * np.eye(3)[None]
        assert solid.there(reach).max() < 0.35 * H


def test_the_told_empty_share_ends_the_choice(oval):
    found = clump(oval[1], H, spheres=500, max_volume_error=0.15, clump_fit="inside")
    assert -0.18 < found.volume_error < -0.12
    assert len(found) < 30


def test_enlarged_spheres_have_the_grain_s_volume_and_nearly_its_inertia(oval):
    solid, surface = oval
    found = clump(surface, H, spheres=20)
    assert found.volume_error == pytest.approx(0, abs=1e-3)
    assert found.density_scale == pytest.approx(1, abs=1e-3)
    np.testing.assert_allclose(found.properties.principal_moments, np.sort(solid.moments), rtol=0.03)
    summed = (4 / 3 * np.pi * found.radii**3).sum()
    assert found.density_scale_of_sum * summed == pytest.approx(found.grain.volume)


def test_a_ball_needs_one_sphere():
    surface = grain_surface(grain(voxels(sphere(1.0))))
    found = clump(surface, H, spheres=20)
    assert len(found) <= 6
    assert found.radii[0] == pytest.approx(1.0, abs=0.3 * H)


def test_two_overlapping_spheres_are_counted_once():
    """V = 2 V₁ − lens, with the lens π (4 R + d)(2 R − d)²/12; and a union far from the origin."""
    d, r = 1.2, 1.0
    centers = np.array([[7.0, -2, 3], [7 + d, -2, 3]])
    found = union_properties(centers, np.array([r, r]))
    exact = 8 / 3 * np.pi * r**3 - np.pi * (4 * r + d) * (2 * r - d) ** 2 / 12
    assert found.volume == pytest.approx(exact, rel=2e-4)
    np.testing.assert_allclose(found.center, [7 + d / 2, -2, 3], atol=1e-3)
    moved = union_properties(centers @ [[0, 1, 0], [0, 0, 1], [1, 0, 0]], np.array([r, r]))
    np.testing.assert_allclose(moved.principal_moments, found.principal_moments, rtol=2e-3)
    assert found.inertia[0, 0] < found.inertia[1, 1]  # long along x


def test_apart_spheres_have_steiner_s_inertia():
    found = union_properties(np.array([[-2.0, 0, 0], [2.0, 0, 0]]), np.array([1.0, 1.0]))
    one = 4 / 3 * np.pi
    np.testing.assert_allclose(
        found.inertia, np.diag([0.8 * one, 0.8 * one + 8 * one, 0.8 * one + 8 * one]), rtol=2e-3, atol=1e-6
    )


def test_wrong_numbers_are_named(oval):
    for options, words in (
        ({"spheres": 0}, "spheres"),
        ({"max_volume_error": 1.0}, "max_volume_error"),
        ({"clump_fit": "outside"}, "outside"),
    ):
        with pytest.raises(InputError, match=words):
            clump(oval[1], H, **options)
    with pytest.raises(InputError, match="spacing"):
        clump(oval[1], 3.0)
