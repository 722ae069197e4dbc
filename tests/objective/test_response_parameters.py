"""Estimating the detector's response at the true pose (`objective.response_parameters`)."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from few_grains import GAIN_AND_OFFSET, geometry, grain_set, small_motions
from grainmotion.model.detector_response import Response
from grainmotion.model.pose import Pose
from grainmotion.model.scan import Scan
from grainmotion.objective.data_term import Target
from grainmotion.objective.residual import StateProblem
from grainmotion.objective.response_parameters import IDENTITY_RESPONSE, ResponseModel
from grainmotion.projection.grain_arrays import GrainArrays
from grainmotion.projection.grains import simulate_radiographs

GRAINS = grain_set(finer=1)
TRUTH = small_motions(GRAINS)
POSE = Pose(TRUTH.translations, TRUTH.matrices)


@cache
def ideal():
    return simulate_radiographs(GRAINS, TRUTH, geometry())


def evaluated(response_of, response_model, sigma=0.7, noise=0.0):
    images = response_of.apply(ideal()) + noise * np.random.default_rng(0).standard_normal(ideal().shape)
    target = Target(
        Scan(images.astype(np.float32), geometry()),
        np.zeros(ideal().shape, np.float32),
        "trilinear",
        sigma,
        response_model,
    )
    return StateProblem(GrainArrays.of(GRAINS), target).evaluate_with_derivatives(POSE)


def response_of(gain=1.0, hardening=(), background=()):
    """A response from numbers, one for all views or one for each view."""
    polynomial = np.stack([np.broadcast_to(g, 4) for g in (gain, *hardening)], axis=1)
    terms = [np.broadcast_to(b, 4) for b in background]
    return Response(polynomial, np.stack(terms, axis=1) if terms else np.zeros((4, 0)))


GAINS = np.array([0.9, 1.0, 1.1, 1.25])
DRIFTS = np.array([0.05, -0.02, 0.0, 0.1])
CASES = {
    "global gain and offset": (response_of(1.1, (), (0.03,)), GAIN_AND_OFFSET),
    "gain and offset per view": (response_of(GAINS, (), (DRIFTS,)), ResponseModel("view")),
    "constants only": (response_of(1.0, (), (DRIFTS,)), ResponseModel("none", "constant")),
    "linear background": (response_of(GAINS, (), (DRIFTS, 0.02, -DRIFTS)), ResponseModel("view", "linear")),
    "quadratic background": (
        response_of(1.1, (), (DRIFTS, 0.02, 0.0, DRIFTS, -0.03, 0.01)),
        ResponseModel("global", "quadratic"),
    ),
    "hardening": (response_of(1.05, (-0.06, 0.01), (0.02,)), ResponseModel("global", "none", 3)),
    "hardening, with a known gain": (response_of(1.0, (-0.06,)), ResponseModel("none", "none", 2)),
    "all": (response_of(GAINS, (-0.05,), (DRIFTS, 0.02, -DRIFTS)), ResponseModel("view", "linear", 2)),
}


class TestSimulatedResponse:
    @pytest.mark.parametrize("sigma", [0.0, 2.0])
    @pytest.mark.parametrize(("response", "response_model"), CASES.values(), ids=CASES.keys())
    def test_is_estimated_at_the_true_pose(self, response, response_model, sigma):
        evaluation = evaluated(response, response_model, sigma)
        np.testing.assert_allclose(evaluation.response.polynomial, response.polynomial, atol=2e-4)
        np.testing.assert_allclose(evaluation.response.background, response.background, atol=2e-4)
        assert np.abs(evaluation.residual).max() < 1e-4
        assert np.abs(evaluation.raw_residual).max() < 1e-4

    def test_is_estimated_to_the_noise(self):
        response, response_model = CASES["all"]
        evaluation = evaluated(response, response_model, noise=0.02)
        np.testing.assert_allclose(evaluation.response.polynomial, response.polynomial, atol=0.02)
        assert np.std(evaluation.raw_residual) == pytest.approx(0.02, rel=0.05)

    def test_a_fixed_response_is_not_estimated(self):
        evaluation = evaluated(response_of(1.1), IDENTITY_RESPONSE)
        assert (evaluation.response.gain, evaluation.response.offset) == (1.0, 0.0)
        np.testing.assert_allclose(evaluation.raw_residual, 0.1 * ideal(), atol=1e-5)

    def test_a_view_without_a_visible_grain_keeps_a_gain_of_one(self):
        """Its gain is not determined and stays 1; its background is determined."""
        views = geometry().vectors.copy()
        views[1, 3:6] += 80 * views[1, 9:12]
        away = replace(geometry(), vectors=views)
        images = simulate_radiographs(GRAINS, TRUTH, away)
        response = response_of(GAINS, (), (DRIFTS,))
        target = Target(
            Scan(response.apply(images), away),
            np.zeros(images.shape, np.float32),
            "trilinear",
            0.7,
            ResponseModel("view"),
        )
        estimated = StateProblem(GrainArrays.of(GRAINS), target).evaluate_with_derivatives(POSE).response
        np.testing.assert_allclose(estimated.polynomial[:, 0], np.where(np.arange(4) == 1, 1.0, GAINS), atol=2e-4)
        np.testing.assert_allclose(estimated.background[:, 0], DRIFTS, atol=2e-4)


class TestMonotone:
    def test_a_curve_that_is_not_monotone_loses_a_degree(self):
        """Line integrals that fall where the grains are thick: the best parabola is refused, the best line used."""
        bent = response_of(1.0, (-0.9 / ideal().max(),), (0.0,))
        quadratic = evaluated(bent, ResponseModel("global", "none", 2))
        linear = evaluated(bent, ResponseModel("global", "none", 1))
        assert quadratic.response.polynomial.shape == (4, 1)
        np.testing.assert_allclose(quadratic.response.polynomial, linear.response.polynomial)
        assert quadratic.response.is_monotone(float(ideal().max()))

    def test_a_monotone_curve_keeps_its_degree(self):
        assert evaluated(
            response_of(1.0, (-0.2 / ideal().max(),), (0.0,)), ResponseModel("global", "none", 2)
        ).response.polynomial[0, 1] == pytest.approx(-0.2 / ideal().max(), rel=1e-3)


@pytest.mark.parametrize(
    ("response_model", "terms"),
    [
        (IDENTITY_RESPONSE, 0),
        (GAIN_AND_OFFSET, 1),
        (ResponseModel("view"), 1),
        (ResponseModel("none", "linear"), 3),
        (ResponseModel("global", "quadratic"), 6),
        (ResponseModel(degree=2), 0),
    ],
)
def test_number_of_background_terms(response_model, terms):
    """A free gain comes with an offset."""
    assert response_model.trend_terms == terms
