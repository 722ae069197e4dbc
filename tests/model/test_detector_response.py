"""The detector's response (`model.detector_response`): values, derivative, monotonicity, refused shapes."""

import numpy as np
import pytest

from grainmotion.errors import InputError
from grainmotion.model.detector_response import TREND_TERMS, Response, trend_terms

SHAPE = (5, 7)


def paths(dtype=np.float64):
    return np.random.default_rng(0).uniform(0, 2, (3, *SHAPE)).astype(dtype)


def response(degree=3, terms=6):
    rng = np.random.default_rng(1)
    return Response(rng.normal(size=(3, degree)), rng.normal(size=(3, terms)))


class TestApply:
    @pytest.mark.parametrize("degree", [1, 2, 4])
    @pytest.mark.parametrize("terms", [0, 1, 3, 6])
    def test_equals_the_sum_of_its_terms(self, degree, terms):
        p, m = paths(), response(degree, terms)
        y, x = np.meshgrid(np.linspace(-1, 1, 5), np.linspace(-1, 1, 7), indexing="ij")
        expected = sum(m.polynomial[:, k, None, None] * p ** (k + 1) for k in range(degree))
        for k, term in enumerate([x**0, x, y, x * x, x * y, y * y][:terms]):
            expected = expected + m.background[:, k, None, None] * term
        np.testing.assert_allclose(m.apply(p), expected, rtol=1e-12, atol=1e-12)

    def test_identity_changes_nothing(self):
        p = paths(np.float32)
        np.testing.assert_array_equal(Response.identity(3).apply(p), p)
        np.testing.assert_array_equal(Response.identity(3).derivative(p), np.ones_like(p))
        assert (Response.identity(3).gain, Response.identity(3).offset) == (1.0, 0.0)

    @pytest.mark.parametrize("dtype", [np.float32, np.float64])
    def test_result_has_the_precision_of_the_input_which_is_not_changed(self, dtype):
        p = paths(dtype)
        before = p.copy()
        assert response().apply(p).dtype == response().derivative(p).dtype == dtype
        np.testing.assert_array_equal(p, before)

    def test_gain_and_offset_are_means_over_views(self):
        m = Response(np.array([[1.0, 5], [1.2, 5]]), np.array([[0.1, 7, 7], [0.3, 7, 7]]))
        assert m.gain == pytest.approx(1.1)
        assert m.offset == pytest.approx(0.2)


class TestDerivative:
    @pytest.mark.parametrize("degree", [1, 2, 3, 4])
    def test_equals_finite_differences(self, degree):
        p, m, step = paths(), response(degree), 1e-5
        np.testing.assert_allclose(m.derivative(p), (m.apply(p + step) - m.apply(p - step)) / (2 * step), atol=1e-7)


class TestMonotone:
    def test_curve_is_not_monotone_beyond_its_maximum(self):
        """p − p²/5 rises to p = 2.5 and falls beyond."""
        m = Response(np.array([[1.0, 0.0], [1.0, -0.2]]), np.zeros((2, 0)))
        assert m.is_monotone(2.4)
        assert not m.is_monotone(2.6)

    def test_one_view_that_is_not_monotone_suffices(self):
        assert not Response(np.array([[1.0], [-0.1]]), np.zeros((2, 0))).is_monotone(1.0)

    def test_monotone_on_an_empty_range(self):
        assert Response.identity(2).is_monotone(0.0)
        assert Response.identity(2).is_monotone(-1.0)


class TestTerms:
    @pytest.mark.parametrize("count", TREND_TERMS.values())
    def test_number_of_terms_and_values_at_a_corner(self, count):
        terms = trend_terms((4, 6), count)
        assert len(terms) == count
        assert [t[-1, 0] for t in terms] == [1, -1, 1, 1, -1, 1][:count]

    def test_terms_on_a_panel_of_one_row(self):
        terms = trend_terms((1, 5), 6)
        assert not terms[2].any()
        assert np.isfinite(terms).all()


class TestRefused:
    @pytest.mark.parametrize(
        ("polynomial", "background"),
        [((3,), (3, 1)), ((3, 0), (3, 1)), ((3, 1), (2, 1)), ((3, 1), (3,)), ((3, 1), (3, 2)), ((3, 1), (3, 1, 1))],
    )
    def test_arrays_of_impossible_shapes(self, polynomial, background):
        with pytest.raises(InputError, match="response"):
            Response(np.ones(polynomial), np.ones(background))
