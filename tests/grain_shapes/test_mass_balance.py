"""Surfaces where attenuation balances: radial profiles of known mass, such as reconstructions give."""

import numpy as np
import pytest
from scipy.integrate import trapezoid
from scipy.special import erfc

from grainmotion.grain_shapes.mass_balance import balancing_shift
from grainmotion.grain_shapes.surface import grain_surface
from grainmotion.grain_shapes.triangle_mesh import Surface
from grainmotion.model.grains import Grain
from grainmotion.model.volume import Volume
from grainmotion.simulate.polyhedra import icosphere

H, R = 0.1, 1.03  # mm: a sphere of 20.6 voxels
PLACE = np.array([0.031, -0.017, 0.043])


def image(profile, samples=3, n=34):
    """Mean over each voxel of a function of the height above the sphere, voxels."""
    t = ((np.arange(n * samples) + 0.5) / samples - n / 2) * H
    z, y, x = (t - p for p in PLACE[::-1])
    height = (np.sqrt(z[:, None, None] ** 2 + y[:, None] ** 2 + x**2) - R) / H
    return profile(height).reshape(n, samples, n, samples, n, samples).mean(axis=(1, 3, 5))


def edge(height, blur=0.4):
    return erfc(height / blur / np.sqrt(2)) / 2


def volume_error(array, truth=4 / 3 * np.pi * R**3):
    surface = grain_surface(Grain(1, Volume(array.astype(np.float32), H), PLACE))
    return surface.volume / truth - 1


def mass(profile):
    """Integral of a profile about the sphere, mm³."""
    radii = np.linspace(0, R + 6 * H, 200_001)
    return 4 * np.pi * trapezoid(profile((radii - R) / H) * radii**2, radii)


def overshoot(height):
    return np.exp(-0.5 * ((height + 1.2) / 0.35) ** 2)


INWARDS = 0.06
AMPLITUDE = (mass(lambda s: s < 0) - mass(lambda s: edge(s + INWARDS))) / mass(overshoot)
"""With which the sum of `clipped` is that of the sphere."""


def clipped(height):
    """An edge without undershoot: half of the attenuation lies too far inside, an overshoot holds what is missing."""
    return edge(height + INWARDS) + AMPLITUDE * overshoot(height)


def test_an_overshoot_without_undershoot_does_not_shrink_the_grain():
    """At half of the attenuation the volume is 1.0 % too small."""
    assert 0.04 < AMPLITUDE < 0.07
    assert abs(volume_error(image(clipped))) < 0.002


@pytest.mark.parametrize(("blur", "bound"), [(0.3, 0.002), (0.6, 0.002), (1.0, 0.006)])
def test_a_profile_without_overshoot_keeps_its_mass(blur, bound):
    assert abs(volume_error(image(lambda s: edge(s, blur)), mass(lambda s: edge(s, blur)))) < bound


def test_attenuation_cut_off_outside_is_not_missed():
    """Labels grown by 1.5 voxels reach about 1 beyond the surface: the tail of a blur of 0.7 voxel is lost there."""
    array = image(lambda s: edge(s, 0.7))
    array[image(lambda s: s) > 1.0] = 0
    assert abs(volume_error(array, mass(lambda s: edge(s, 0.7)))) < 0.006


def test_haze_inclusions_and_loose_pieces_change_little():
    array = image(edge)
    inside = image(lambda s: s)
    rng = np.random.default_rng(0)
    dense = (rng.random(array.shape) < 0.01) & (inside < -1)
    array = np.where(dense, 3.0, array)
    array = 0.99 * array + 0.01
    array[2:4, 2:4, 2:4] = 1
    assert abs(volume_error(array)) < 0.01


def test_a_surface_far_from_the_balance_stays():
    """Half of the attenuation is no grain's surface where the voxels are those of a body of half the radius."""
    inside = image(lambda s: s) < -R / H / 2
    share, normals = inside.astype(float), SPHERE.vertices / np.linalg.norm(SPHERE.vertices, axis=1, keepdims=True)
    surface = SPHERE.moved(R * np.eye(3), PLACE)
    assert balancing_shift(share, inside, surface, normals, Volume(share, H), 0.5) == 0


SPHERE = Surface(*icosphere(4))
