"""Cramér–Rao bounds (`simulate.cramer_rao`): closed form, additivity, photons, coupling."""

import dataclasses

import numpy as np
import pytest

from grainmotion.model.geometry import Geometry
from grainmotion.simulate import Ellipsoid, Particle, Physics, Sample, motion_bounds, small, stone
from grainmotion.simulate.scenarios import SMALL_SCALE

PHYSICS = Physics(photons=20_000.0)
CONE = SMALL_SCALE.scanner.geometry((0.0, 50.0, 90.0, 140.0))


def ball(center, radius, attenuation=0.1):
    return Particle(Ellipsoid(np.asarray(center, dtype=float), np.full(3, radius), np.eye(3)), attenuation)


def pebble(center=(0.0, 0.0, 0.0), index=4, attenuation=0.1):
    return Particle(stone(index, 2.5, level=3).moved(np.eye(3), center), attenuation)


def alone(particle):
    return Sample((particle,))


def variances(covariances):
    return np.diagonal(covariances, axis1=1, axis2=2)


def ball_information(geometry, center, radius, attenuation, photons):
    """Information (3, 3) about a ball's centre in parallel beams, by quadrature over each pixel.

    The mean of ∂p/∂x over a pixel is the difference of p's means over two of its edges.
    """
    information = np.zeros((3, 3))
    rows, columns = geometry.shape
    pixel = geometry.pixel_sizes[0, 0]
    fine = (np.arange(400) + 0.5) / 400 - 0.5
    for view in geometry.vectors:
        u, v = view[6:9] / pixel, view[9:12] / pixel
        x = (np.arange(columns) - (columns - 1) / 2) * pixel - (center - view[3:6]) @ u
        y = (np.arange(rows) - (rows - 1) / 2) * pixel - (center - view[3:6]) @ v

        def path(x, y):
            return 2 * attenuation * np.sqrt(np.clip(radius**2 - x**2 - y**2, 0, None))

        edges = np.append(x, x[-1] + pixel) - pixel / 2
        across = path(edges[None, :, None], y[:, None, None] + fine * pixel).mean(axis=-1)
        along_x = -np.diff(across, axis=1) / pixel
        edges = np.append(y, y[-1] + pixel) - pixel / 2
        across = path(x[None, :, None] + fine * pixel, edges[:, None, None]).mean(axis=-1)
        along_y = -np.diff(across, axis=0) / pixel
        sub = fine[::10] * pixel
        mean = path((x[:, None] + sub).ravel(), (y[:, None] + sub).ravel()[:, None])
        mean = mean.reshape(rows, len(sub), columns, len(sub)).mean(axis=(1, 3))
        gradient = along_x[..., None] * u + along_y[..., None] * v
        information += np.einsum("rci,rcj,rc->ij", gradient, gradient, photons * np.exp(-mean))
    return information


class TestBall:
    geometry = Geometry.parallel([0.0, 70.0], (32, 36), 0.1)
    center = np.array([0.13, -0.07, 0.044])

    def test_translations_have_the_bound_of_the_analytic_chord(self):
        bounds = motion_bounds(alone(ball(self.center, 1.0, 0.3)), self.geometry, PHYSICS, gain=False)
        expected = np.linalg.inv(ball_information(self.geometry, self.center, 1.0, 0.3, PHYSICS.photons))
        np.testing.assert_allclose(bounds[0, :3, :3], expected, atol=0.01 * expected.max())

    def test_rotations_of_a_ball_are_undetermined(self):
        bounds = motion_bounds(alone(ball(self.center, 1.0)), self.geometry, PHYSICS)
        assert np.isinf(variances(bounds)[0, 3:]).all()
        assert np.isfinite(variances(bounds)[0, :3]).all()
        assert np.isnan(bounds[0, 3, :3]).all()

    def test_one_parallel_view_does_not_determine_motion_along_its_rays(self):
        bounds = variances(motion_bounds(alone(ball(self.center, 1.0)), self.geometry[0], PHYSICS))[0]
        assert np.isinf(bounds[1])
        assert np.isfinite(bounds[[0, 2]]).all()


def test_information_adds_up_over_views():
    sample = alone(pebble())
    parts = [motion_bounds(sample, CONE[views], PHYSICS, gain=False)[0] for views in ([0, 1], [2, 3], [0, 1, 2, 3])]
    first, second, both = (np.linalg.inv(c) for c in parts)
    np.testing.assert_allclose(first + second, both, rtol=1e-6, atol=1e-9 * both.max())


@pytest.mark.parametrize("gain", [True, False])
def test_variance_falls_as_the_photons_grow(gain):
    sample = Sample((pebble(), pebble((0.5, 2.4, 0.3), 7)))
    once, thrice = (
        motion_bounds(sample, CONE, Physics(photons=n), gain=gain, subsamples=2) for n in (10_000.0, 30_000.0)
    )
    np.testing.assert_allclose(once, 3 * thrice, rtol=1e-6, atol=1e-9 * np.abs(once).max())


def test_bounds_are_symmetric_positive_and_converged_in_the_number_of_rays():
    sample = Sample((pebble(), pebble((0.5, 2.4, 0.3), 7)))
    coarse, fine = (motion_bounds(sample, CONE, PHYSICS, subsamples=n) for n in (6, 10))
    assert coarse.dtype == np.float64
    np.testing.assert_allclose(coarse, coarse.transpose(0, 2, 1))
    assert (np.linalg.eigvalsh(coarse) > 0).all()
    np.testing.assert_allclose(variances(coarse), variances(fine), rtol=0.03)


class TestCoupling:
    def test_grains_without_a_common_pixel_are_uncoupled(self):
        first, second = pebble((0.0, 0.0, -2.5)), pebble((0.0, 0.0, 2.5), 7)
        both = motion_bounds(Sample((first, second)), CONE, PHYSICS, gain=False)
        for row, particle in enumerate((first, second)):
            own = motion_bounds(alone(particle), CONE, PHYSICS, gain=False)[0]
            np.testing.assert_allclose(both[row], own, rtol=1e-7, atol=1e-9 * np.abs(own).max())

    def test_grains_behind_each_other_have_larger_variances(self):
        thin = 1e-3  # so that neither reduces the photons of the other noticeably
        first, second = pebble((0.0, 0.0, 0.0), attenuation=thin), pebble((0.6, 2.4, 0.4), 7, thin)
        both = motion_bounds(Sample((first, second)), CONE[[0, 1]], PHYSICS, gain=False)
        own = motion_bounds(alone(first), CONE[[0, 1]], PHYSICS, gain=False)
        assert (variances(both)[0] > variances(own)[0]).all()

    def test_an_unknown_gain_increases_variances(self):
        sample = Sample((pebble(), pebble((0.5, 2.4, 0.3), 7)))
        known, unknown = (variances(motion_bounds(sample, CONE, PHYSICS, gain=g, subsamples=2)) for g in (False, True))
        assert (unknown >= known * (1 - 1e-9)).all()
        assert unknown.sum() > known.sum()

    def test_a_grain_off_the_panel_is_undetermined_and_does_not_affect_others(self):
        first, off_panel = pebble(), pebble((0.0, 0.0, 30.0), 7)
        bounds = variances(motion_bounds(Sample((first, off_panel)), CONE, PHYSICS, subsamples=2))
        own = variances(motion_bounds(alone(first), CONE, PHYSICS, subsamples=2))
        assert np.isinf(bounds[1]).all()
        np.testing.assert_allclose(bounds[0], own[0], rtol=1e-7)


class TestPhysics:
    def test_one_energy_is_a_factor_of_the_attenuation(self):
        hard = dataclasses.replace(PHYSICS, spectrum=((1.0, 2.0),))
        np.testing.assert_allclose(
            motion_bounds(alone(pebble()), CONE, hard, subsamples=2),
            motion_bounds(alone(pebble(attenuation=0.2)), CONE, PHYSICS, subsamples=2),
            rtol=1e-6,
            atol=1e-15,
        )

    def test_blur_loses_information(self):
        blurred = dataclasses.replace(PHYSICS, blur=1.0)
        sharp, soft = (variances(motion_bounds(alone(pebble()), CONE, p, subsamples=2)) for p in (PHYSICS, blurred))
        assert (soft > sharp).all()

    def test_the_small_case_has_hundredths_of_a_voxel_and_of_a_degree(self):
        case = small()
        bounds = variances(motion_bounds(case.sample, CONE, case.physics, subsamples=3))
        assert 0.002 < np.sqrt(bounds[:, :3].mean()) / case.scanner.voxel_size < 0.004
        assert 0.02 < np.rad2deg(np.sqrt(bounds[:, 3:].mean())) < 0.035
