"""Responses that were planted are found at the true pose, and one that bends back is none."""

from dataclasses import replace

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
IDEAL = simulate_radiographs(GRAINS, TRUTH, geometry())
NOTHING = np.zeros(IDEAL.shape, np.float32)


def seen(planted, response_model, sigma=0.7, noise=0.0):
    images = planted.apply(IDEAL) + noise * np.random.default_rng(0).standard_normal(IDEAL.shape)
    target = Target(Scan(images.astype(np.float32), geometry()), NOTHING, "trilinear", sigma, response_model)
    return StateProblem(GrainArrays.of(GRAINS), target).evaluate_with_derivatives(POSE)


def planted(gain=1.0, hardening=(), background=()):
    """A response from numbers, one for all views or one a view."""
    polynomial = np.stack([np.broadcast_to(g, 4) for g in (gain, *hardening)], axis=1)
    terms = [np.broadcast_to(b, 4) for b in background]
    return Response(polynomial, np.stack(terms, axis=1) if terms else np.zeros((4, 0)))


GAINS = np.array([0.9, 1.0, 1.1, 1.25])
DRIFTS = np.array([0.05, -0.02, 0.0, 0.1])
CASES = {
    "global gain and offset": (planted(1.1, (), (0.03,)), GAIN_AND_OFFSET),
    "gain and offset per view": (planted(GAINS, (), (DRIFTS,)), ResponseModel("view")),
    "constants alone": (planted(1.0, (), (DRIFTS,)), ResponseModel("none", "constant")),
    "linear background": (planted(GAINS, (), (DRIFTS, 0.02, -DRIFTS)), ResponseModel("view", "linear")),
    "quadratic background": (
        planted(1.1, (), (DRIFTS, 0.02, 0.0, DRIFTS, -0.03, 0.01)),
        ResponseModel("global", "quadratic"),
    ),
    "hardening": (planted(1.05, (-0.06, 0.01), (0.02,)), ResponseModel("global", "none", 3)),
    "hardening, with the gain known": (planted(1.0, (-0.06,)), ResponseModel("none", "none", 2)),
    "all": (planted(GAINS, (-0.05,), (DRIFTS, 0.02, -DRIFTS)), ResponseModel("view", "linear", 2)),
}


class TestPlanted:
    @pytest.mark.parametrize("sigma", [0.0, 2.0])
    @pytest.mark.parametrize(("response", "response_model"), CASES.values(), ids=CASES.keys())
    def test_found_at_the_true_pose(self, response, response_model, sigma):
        found = seen(response, response_model, sigma)
        np.testing.assert_allclose(found.response.polynomial, response.polynomial, atol=2e-4)
        np.testing.assert_allclose(found.response.background, response.background, atol=2e-4)
        assert np.abs(found.residual).max() < 1e-4
        assert np.abs(found.raw_residual).max() < 1e-4

    def test_with_noise_within_its_means(self):
        response, response_model = CASES["all"]
        found = seen(response, response_model, noise=0.02)
        np.testing.assert_allclose(found.response.polynomial, response.polynomial, atol=0.02)
        assert np.std(found.raw_residual) == pytest.approx(0.02, rel=0.05)

    def test_nothing_unknown(self):
        found = seen(planted(1.1), IDENTITY_RESPONSE)
        assert (found.response.gain, found.response.offset) == (1.0, 0.0)
        np.testing.assert_allclose(found.raw_residual, 0.1 * IDEAL, atol=1e-5)

    def test_a_view_on_which_no_grain_is_seen(self):
        """Its gain is not known, and is left at 1; its background is."""
        views = geometry().vectors.copy()
        views[1, 3:6] += 80 * views[1, 9:12]
        away = replace(geometry(), vectors=views)
        ideal = simulate_radiographs(GRAINS, TRUTH, away)
        response = planted(GAINS, (), (DRIFTS,))
        target = Target(Scan(response.apply(ideal), away), NOTHING, "trilinear", 0.7, ResponseModel("view"))
        found = StateProblem(GrainArrays.of(GRAINS), target).evaluate_with_derivatives(POSE).response
        np.testing.assert_allclose(found.polynomial[:, 0], np.where(np.arange(4) == 1, 1.0, GAINS), atol=2e-4)
        np.testing.assert_allclose(found.background[:, 0], DRIFTS, atol=2e-4)


class TestMonotone:
    def test_a_curve_that_bends_back_loses_a_degree(self):
        """Radiographs that fall where the grains are thick: the best parabola is refused, the best line taken."""
        bent = planted(1.0, (-0.9 / IDEAL.max(),), (0.0,))
        found = seen(bent, ResponseModel("global", "none", 2))
        line = seen(bent, ResponseModel("global", "none", 1))
        assert found.response.polynomial.shape == (4, 1)
        np.testing.assert_allclose(found.response.polynomial, line.response.polynomial)
        assert found.response.is_monotone(float(IDEAL.max()))

    def test_one_that_hardly_bends_stays(self):
        assert seen(
            planted(1.0, (-0.2 / IDEAL.max(),), (0.0,)), ResponseModel("global", "none", 2)
        ).response.polynomial[0, 1] == pytest.approx(-0.2 / IDEAL.max(), rel=1e-3)


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
def test_terms_of_the_background(response_model, terms):
    """An offset goes with every gain."""
    assert response_model.trend_terms == terms
