"""Noise model and weights of pixels (`uncertainty.noise_model`): simulated noise, outliers, Poisson likelihood."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from few_grains import VOXEL, geometry, grain_set, small_motions, smooth_grains
from grainmotion.model.geometry import Geometry
from grainmotion.model.pose import Pose
from grainmotion.model.scan import Scan
from grainmotion.objective.data_term import Target
from grainmotion.objective.residual import StateProblem
from grainmotion.objective.response_parameters import IDENTITY_RESPONSE, ResponseModel
from grainmotion.projection.grain_arrays import GrainArrays
from grainmotion.projection.grains import simulate_radiographs
from grainmotion.solvers.gauss_newton import gauss_newton
from grainmotion.solvers.stopping import Stopping
from grainmotion.uncertainty.noise_model import (
    HUBER_SD,
    NoiseModel,
    noise_level,
    noise_model,
    noise_shares,
    open_beam,
    reweighted,
    shaded_pixels,
    squared_gradient,
)
from textured_lumps import GEOMETRY as LUMPS_GEOMETRY
from textured_lumps import PANEL as LUMPS_PANEL

GRAINS = grain_set(finer=1)
PACKED = GrainArrays.of(GRAINS)
TRUTH = small_motions(GRAINS)
POSE = Pose(TRUTH.translations, TRUTH.matrices)
BEAM = 1 + 0.4 * np.linspace(-1, 1, 64) * np.ones((52, 1))


@cache
def ideal():
    return simulate_radiographs(GRAINS, TRUTH, geometry()).astype(float)


def rng(seed=0):
    return np.random.default_rng(seed)


def poisson_line_integrals(photons, beam=1.0, seed=0):
    """Line integrals of Poisson counts."""
    counts = rng(seed).poisson(photons * beam * np.exp(-ideal()))
    return -np.log(np.maximum(counts, 0.5) / (photons * beam))


def problem(images, valid=None, beam=None, response_model=IDENTITY_RESPONSE, sigma=0.0):
    scan = Scan(images.astype(np.float32), geometry(), valid, beam)
    return StateProblem(PACKED, Target(scan, np.zeros(ideal().shape, np.float32), "trilinear", sigma, response_model))


def model(images, pose=POSE, **target):
    at = problem(images, **target)
    return noise_model(at.target, at.evaluate_with_derivatives(pose))


class TestNoiseModel:
    @pytest.mark.parametrize("photons", [1e3, 2e4])
    @pytest.mark.parametrize("beam", [None, BEAM], ids=["even beam", "uneven beam"])
    def test_number_of_photons_is_estimated(self, photons, beam):
        models = [model(poisson_line_integrals(photons, 1.0 if beam is None else beam, k), beam=beam) for k in range(4)]
        assert np.mean([f.photons for f in models]) == pytest.approx(photons, rel=0.15)
        assert max(f.even for f in models) < 0.7 * np.sqrt(1 / photons)
        assert max(f.edge for f in models) < 0.05
        truth = NoiseModel(photons, 0.0, 0.0).variance(ideal(), open_beam(problem(ideal(), beam=beam).target))
        np.testing.assert_allclose(np.mean([f.variance(ideal(), 1.0) for f in models]) / truth.mean(), 1, atol=0.25)

    def test_white_noise_is_estimated(self):
        estimated = model(ideal() + 0.03 * rng().standard_normal(ideal().shape))
        assert estimated.even == pytest.approx(0.03, rel=0.1)
        assert 1 / estimated.photons < 0.3 * 0.03**2

    def test_photon_noise_and_white_noise_are_separated(self):
        estimated = model(poisson_line_integrals(2e3) + 0.05 * rng(1).standard_normal(ideal().shape))
        assert estimated.even == pytest.approx(0.05, rel=0.2)
        assert estimated.photons == pytest.approx(2e3, rel=0.4)
        truth = NoiseModel(2e3, 0.05, 0.0).variance(ideal(), 1.0)
        np.testing.assert_allclose(estimated.variance(ideal(), 1.0), truth, rtol=0.2)

    def test_an_error_at_edges_is_estimated(self):
        """Views shifted by a fraction of a pixel leave residuals proportional to the image's gradient."""
        along_columns = np.gradient(ideal(), axis=2)
        shifted = (
            ideal()
            + 0.3 * rng(2).choice([-1, 1], size=(4, 1, 1)) * along_columns
            + 0.005 * rng().standard_normal(ideal().shape)
        )
        estimated = model(shifted)
        along_rows = np.gradient(ideal(), axis=1)
        share = np.sqrt((along_columns**2).sum() / (along_columns**2 + along_rows**2).sum())
        assert estimated.edge == pytest.approx(0.3 * share, rel=0.3)
        assert estimated.even < 0.02

    def test_outliers_and_masked_pixels_do_not_matter(self):
        images = poisson_line_integrals(2e3)
        valid = rng(3).uniform(size=ideal().shape) > 0.05
        plain = model(images)
        spoiled = np.where(valid, images, 50.0)
        np.testing.assert_allclose(model(spoiled, valid=valid).photons, plain.photons, rtol=0.15)
        with_outliers = np.where(rng(4).uniform(size=ideal().shape) < 0.01, images + 1.0, images)
        np.testing.assert_allclose(model(with_outliers).photons, plain.photons, rtol=0.25)

    def test_discounted_pixels_show_nothing_about_the_others(self):
        at = problem(ideal() + 0.01 * rng().standard_normal(ideal().shape))
        target, evaluation = at.target, at.evaluate(POSE)
        raw, discount = evaluation.raw_residual.copy(), np.ones_like(evaluation.raw_residual)
        raw[:, 20:30] += 0.2
        discount[:, 20:30] = 0.01
        wrong = replace(evaluation, raw_residual=raw)
        expected = noise_model(target, evaluation)
        found = noise_model(replace(target, discount=discount), wrong)
        assert found.even == pytest.approx(expected.even, rel=0.1)
        assert noise_model(target, wrong).even > 2 * expected.even

    def test_without_noise_the_variance_is_small_and_finite(self):
        estimated = model(ideal())
        assert np.isfinite(estimated.variance(ideal(), 1.0)).all()
        assert estimated.variance(ideal(), 1.0).max() < 1e-6

    @pytest.mark.parametrize("shape", [(1, 1), (5, 2), (1, 64)])
    def test_tiny_panels_give_finite_shares(self, shape):
        unit = np.ones((2, *shape))
        assert np.isfinite(noise_shares(0.1 * rng().standard_normal((2, *shape)), unit, unit > 0)).all()

    def test_squared_gradient(self):
        y, x = np.mgrid[:6, :7].astype(float)
        np.testing.assert_allclose(squared_gradient((2 * x - 3 * y)[None]), 13)
        np.testing.assert_allclose(squared_gradient(2 * x[None, :1]), 4)
        np.testing.assert_array_equal(squared_gradient(np.ones((2, 1, 1))), 0)


class TestWeights:
    def test_uniform_weights_are_one(self):
        at = problem(poisson_line_integrals(1e3))
        target, share = reweighted(at.target, at.evaluate_with_derivatives(POSE), "uniform", "squares")
        np.testing.assert_array_equal(target.weights, 1)
        assert share == 0

    def test_photon_weights_are_the_inverse_variance(self):
        at = problem(poisson_line_integrals(1e3, BEAM), beam=BEAM)
        target, _ = reweighted(at.target, at.evaluate_with_derivatives(POSE), "photons", "squares")
        truth = BEAM * np.exp(-ideal())
        assert target.weights.mean() == pytest.approx(1)
        np.testing.assert_allclose(target.weights, truth / truth.mean(), rtol=0.15)

    def test_masked_pixels_do_not_count_in_the_mean_weight(self):
        valid = rng(3).uniform(size=ideal().shape) > 0.5
        at = problem(poisson_line_integrals(1e3), valid)
        target, _ = reweighted(at.target, at.evaluate_with_derivatives(POSE), "photons", "squares")
        assert target.weights[valid].mean() == pytest.approx(1)

    def test_downweighted_share_is_that_of_the_outliers(self):
        images = ideal() + 0.02 * rng().standard_normal(ideal().shape)
        clean = problem(images)
        target, share = reweighted(clean.target, clean.evaluate_with_derivatives(POSE), "uniform", "huber")
        assert share < 0.01  # 0.27 % of normal numbers are beyond three deviations
        outliers = rng(5).uniform(size=ideal().shape) < 0.05
        spoiled = problem(np.where(outliers, images + 0.8, images))
        target, share = reweighted(spoiled.target, spoiled.evaluate_with_derivatives(POSE), "uniform", "huber")
        shaded = shaded_pixels(spoiled.target, spoiled.evaluate_with_derivatives(POSE))
        assert share == pytest.approx(outliers[shaded].mean(), rel=0.2)
        inside = np.median(target.weights[~outliers])
        assert target.weights[outliers].max() < 0.2 * inside
        assert (target.weights[~outliers] > 0.99 * inside).mean() > 0.98

    def test_huber_weight_is_three_deviations_over_the_residual(self):
        noisy = ideal() + 0.02 * rng().standard_normal(ideal().shape)
        at = problem(np.where(rng(5).uniform(size=ideal().shape) < 0.01, noisy + 0.5, noisy))
        evaluation = at.evaluate_with_derivatives(POSE)
        target, _ = reweighted(at.target, evaluation, "uniform", "huber")
        noise = noise_model(at.target, evaluation, HUBER_SD)
        assert noise.even == pytest.approx(0.02, rel=0.1)
        size = np.abs(evaluation.raw_residual) / np.sqrt(noise.variance(ideal(), 1.0))
        expected = np.minimum(1, HUBER_SD / size)
        np.testing.assert_allclose(target.weights / target.weights.max(), expected / expected.max(), rtol=1e-3)

    def test_open_beam_is_one_unless_given(self):
        assert open_beam(problem(ideal()).target) == 1.0
        assert open_beam(problem(ideal(), beam=BEAM).target) is not None


SMOOTH = GrainArrays.of(smooth_grains())
TRUE_POSE = Pose(np.array([[0.05, -0.08, 0.1], [-0.1, 0.03, 0.06]]), np.tile(np.eye(3), (2, 1, 1)))


def counts(photons):
    """The problem of two smooth grains from Poisson counts, and the counts."""
    views = geometry()
    nothing = Target(Scan(np.zeros(ideal().shape, np.float32), views), np.zeros(ideal().shape), "trilinear", 0.0)
    path = StateProblem(SMOOTH, nothing).evaluate_with_derivatives(TRUE_POSE).line_integrals
    drawn = np.maximum(rng().poisson(photons * np.exp(-path)), 0.5)
    return StateProblem(SMOOTH, replace(nothing, scan=Scan(-np.log(drawn / photons), views))), drawn


class TestPoisson:
    def likelihood(self, problem, counts, photons, pose):
        """Minus the log-likelihood."""
        path = problem.evaluate_with_derivatives(pose).line_integrals
        return float((counts * path + photons * np.exp(-path)).sum())

    def score(self, problem, counts, photons, pose, step=2e-3):
        """Central differences of minus the log-likelihood, over its standard deviations, and these."""
        derivatives = np.zeros(12)
        for k in range(12):
            ends = [
                self.likelihood(problem, counts, photons, problem.retract(pose, sign * step * np.eye(12)[k]))
                for sign in (1, -1)
            ]
            derivatives[k] = (ends[0] - ends[1]) / (2 * step)
        weights = photons * np.exp(-problem.evaluate_with_derivatives(pose).line_integrals)
        fisher = replace(problem, target=replace(problem.target, weights=weights)).linearize(pose).hessian.diagonal()
        return derivatives / np.sqrt(fisher), np.sqrt(fisher)

    def test_gradient_of_weighted_squares_is_the_score(self):
        """The gradient of the reweighted squares equals that of the likelihood at any pose."""
        photons = 200.0
        at, drawn = counts(photons)
        pose = Pose(TRUE_POSE.translations + 0.3 * VOXEL, TRUE_POSE.matrices)
        target, _ = reweighted(at.target, at.evaluate_with_derivatives(pose), "uniform", "poisson")
        scale = photons * np.exp(-at.evaluate_with_derivatives(pose).line_integrals).mean()  # weights have a mean of 1
        gradient = scale * replace(at, target=target).linearize(pose).gradient
        scores, deviations = self.score(at, drawn, photons, pose)
        assert np.abs(scores).max() > 3
        np.testing.assert_allclose(gradient / deviations, scores, atol=0.1)

    def test_iterated_weights_end_at_a_score_of_zero(self):
        """Iteration ends at a stationary point of the likelihood; unweighted squares do not."""
        photons = 40.0
        at, drawn = counts(photons)
        stopping = Stopping(30, 1e-6, 1e-14)
        pose = plain = gauss_newton(at, TRUE_POSE, stopping).state
        working, share = at, 1.0
        for _ in range(5):
            target, share = reweighted(at.target, at.evaluate_with_derivatives(pose), "uniform", "poisson")
            working = replace(working, target=target)
            pose = gauss_newton(working, pose, stopping).state
        assert share == 0
        assert np.abs(self.score(at, drawn, photons, pose)[0]).max() < 0.08
        assert np.abs(self.score(at, drawn, photons, plain)[0]).max() > 0.25

    def test_pixels_without_a_photon_get_finite_weights(self):
        images = poisson_line_integrals(60.0)
        images[:, 20:24, 30:34] = 30.0
        at = problem(images, response_model=ResponseModel("global"))
        target, _ = reweighted(at.target, at.evaluate_with_derivatives(POSE), "photons", "poisson")
        assert np.isfinite(target.scan.line_integrals).all()
        assert np.isfinite(target.weights).all()


class TestNoiseLevel:
    @pytest.mark.parametrize("noise", [0.005, 0.03])
    def test_white_noise_on_smooth_images(self, noise):
        rng = np.random.default_rng(7)
        smooth = np.hypot(*(np.mgrid[:34, :46] - np.array([17, 23])[:, None, None]) / 6) ** 2
        images = np.exp(-smooth) + noise * rng.standard_normal((3, *LUMPS_PANEL))
        assert noise_level(Scan(images, LUMPS_GEOMETRY)) == pytest.approx(noise, rel=0.15)

    def test_without_noise_the_level_is_zero(self):
        assert noise_level(Scan(np.zeros((3, *LUMPS_PANEL), np.float32), LUMPS_GEOMETRY)) == 0

    def test_a_panel_too_narrow_gives_zero(self):
        assert noise_level(Scan(np.zeros((1, 5, 2), np.float32), Geometry.parallel([0.0], (5, 2), 1.0))) == 0


def test_some_rows_of_many_pixels_show_the_noise(monkeypatch):
    """Every eighth row of 200 gives the variance of the pixels that was drawn, as all of them do."""
    unit = np.exp(np.linspace(0, 2, 400)) * np.ones((2, 200, 1)) * 1e-4
    variance = 0.5 * unit + 1e-5
    raw = np.sqrt(variance) * rng().standard_normal(unit.shape)
    every = noise_shares(raw, unit, unit > 0)
    monkeypatch.setattr("grainmotion.uncertainty.noise_model.PIXELS_OF_NOISE", raw.size // 8)
    some = noise_shares(raw, unit, unit > 0)
    assert some != every
    for share, white in (every, some):
        np.testing.assert_allclose(share * unit + white, variance, rtol=0.1)
