"""Ellipsoids (`tracking.ellipsoids`): their line integrals, and their fit to what is left of radiographs."""

import numpy as np
import pytest

from grainmotion.model.geometry import Geometry
from grainmotion.simulate import Ellipsoid as Exact
from grainmotion.simulate import Particle, Sample, line_integrals
from grainmotion.tracking.ellipsoids import Ellipsoid, Usual, ellipsoid_images, fit_ellipsoids

GEOMETRY = Geometry.cone((0.0, 50.0, 110.0), (40, 48), 0.25, source_to_axis=60.0, source_to_detector=120.0)
AXES = np.array([[0.9, 0.1, 0.0], [0.1, 0.7, -0.05], [0.0, -0.05, 0.8]])
ONE = Ellipsoid(np.array([0.4, -0.3, 0.5]), AXES, 0.12, np.full((10, 10), np.nan))
OTHER = Ellipsoid.ball(np.array([-0.9, 0.8, 0.2]), 0.7, 0.1)
USUAL = Usual(0.8, 0.11)


def test_line_integrals_are_those_of_the_simulator():
    values, vectors = np.linalg.eigh(ONE.axes)
    vectors[:, 0] *= np.linalg.det(vectors)
    shape = Exact(ONE.center, values, vectors)
    exact = line_integrals(Sample((Particle(shape, ONE.attenuation),)), GEOMETRY, subsamples=1)
    np.testing.assert_allclose(ellipsoid_images([ONE], GEOMETRY), exact, atol=1e-4)


def test_a_parallel_beam():
    geometry = Geometry.parallel((0.0,), (40, 48), 0.12)
    image = ellipsoid_images([OTHER], geometry)[0]
    row, column = np.unravel_index(np.argmax(image), image.shape)
    np.testing.assert_allclose([row, column], geometry.project_points(OTHER.center)[0, 0], atol=1)
    assert image.max() == pytest.approx(2 * OTHER.radius * OTHER.attenuation, rel=0.01)


def test_two_are_fitted_together():
    noise = np.random.default_rng(1).normal(scale=0.002, size=(3, 40, 48))
    images = ellipsoid_images([ONE, OTHER], GEOMETRY) + noise
    starts = [Ellipsoid.ball(each.center + 0.15, USUAL.radius, USUAL.attenuation) for each in (ONE, OTHER)]
    found = fit_ellipsoids(images, GEOMETRY, starts, USUAL, np.ones_like(images))
    for each, truth in zip(found, (ONE, OTHER), strict=True):
        np.testing.assert_allclose(each.center, truth.center, atol=0.03)
        assert each.radius == pytest.approx(truth.radius, rel=0.03)
        assert each.attenuation == pytest.approx(truth.attenuation, rel=0.1)
        assert (np.abs(each.center - truth.center) < 3 * each.center_sd).all()
        assert abs(each.radius - truth.radius) < 3 * each.radius_sd
    np.testing.assert_allclose(found[0].axes, ONE.axes, atol=0.08)


def test_bad_pixels_do_not_count():
    images = ellipsoid_images([ONE], GEOMETRY)
    valid = np.ones_like(images)
    valid[:, :, 20:24] = 0
    images = np.where(valid > 0, images, 50.0)
    start = Ellipsoid.ball(ONE.center + 0.1, USUAL.radius, USUAL.attenuation)
    (found,) = fit_ellipsoids(images * valid, GEOMETRY, [start], USUAL, valid)
    np.testing.assert_allclose(found.center, ONE.center, atol=0.05)


def test_none_is_none():
    assert fit_ellipsoids(np.zeros((3, 40, 48)), GEOMETRY, [], USUAL, np.ones((3, 40, 48))) == []
