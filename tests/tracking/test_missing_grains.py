"""Missing grains (`tracking.missing_grains`): support by the radiographs, suspects, completed motions."""

from dataclasses import replace

import numpy as np
import pytest

from few_grains import GAIN_AND_OFFSET, grain_set, motions, radiographs, small_motions
from grainmotion.model.motions import Motions, Status
from grainmotion.model.pose import Pose
from grainmotion.model.scan import Scan
from grainmotion.model.state_fit import StateFit
from grainmotion.objective.data_term import Target
from grainmotion.objective.residual import StateProblem
from grainmotion.projection.grain_arrays import GrainArrays
from grainmotion.tracking.missing_grains import complete, grain_supports, improves, suspects

TRUTH = small_motions(grain_set(finer=1))


def supports_of(scan, truth=TRUTH):
    target = Target(scan, np.zeros(scan.line_integrals.shape, np.float32), "trilinear", 2.0, GAIN_AND_OFFSET)
    supports = grain_supports(
        StateProblem(GrainArrays.of(grain_set()), target), Pose(truth.translations, truth.matrices)
    )
    return np.array([support.share for support in supports])


class TestSupport:
    def test_support_of_present_grains_is_one(self):
        np.testing.assert_allclose(supports_of(radiographs(grain_set(), TRUTH)), 1, atol=0.02)

    def test_support_of_an_absent_grain_is_zero(self):
        rest = grain_set().without([1])
        truth = replace(
            Motions.identity(rest.labels, rest.centers),
            translations=np.delete(TRUTH.translations, 1, axis=0),
            rotations=np.delete(TRUTH.rotations, 1, axis=0),
        )
        supports = supports_of(radiographs(rest, truth))
        assert supports[1] == pytest.approx(0, abs=0.02)
        assert np.delete(supports, 1).min() > 0.75  # they share pixels with the absent one

    def test_support_of_grains_of_half_the_attenuation(self):
        scan = radiographs(grain_set(), TRUTH, gain=0.5)
        assert (np.abs(supports_of(scan) - 0.4) < 0.15).all()  # less than a half where two such grains overlap

    def test_masked_pixels_do_not_count(self):
        scan = radiographs(grain_set(), TRUTH)
        valid = np.random.default_rng(0).uniform(size=scan.line_integrals.shape) > 0.3
        images = np.where(valid, scan.line_integrals, 100).astype(np.float32)
        np.testing.assert_allclose(supports_of(Scan(images, scan.geometry, valid)), 1, atol=0.02)

    def test_support_of_invisible_grains_is_nan(self):
        away = replace(TRUTH, translations=TRUTH.translations + np.array([0, 0, 50.0]))
        assert np.isnan(supports_of(radiographs(grain_set(), TRUTH), away)).all()


def classified(statuses, cost=0.1):
    n = len(statuses)
    start = Motions.identity(np.arange(1, n + 1), np.zeros((n, 3)))
    return replace(
        start, statuses=np.array([s.value for s in statuses]), fit=StateFit(costs=(("free", 1.0), ("free", cost)))
    )


OK, BAD, LEFT = Status.CONVERGED, Status.NOT_CONVERGED, Status.LEFT_FIELD


class TestSuspects:
    @pytest.mark.parametrize(
        ("statuses", "supports", "expected"),
        [
            ([OK, OK, OK, BAD], [0.1, 1, 1, 0.2], [[3]]),
            ([OK, OK, OK, BAD], [1, 1, 1, 0.9], []),
            ([OK, OK, OK, LEFT], [1, 1, 1, 0.0], []),
            ([OK, OK, OK, BAD], [1, 1, 1, np.nan], []),
            ([OK, OK, BAD, BAD], [1, 1, 0.3, 0.1], [[3], [2]]),
            ([OK, BAD, BAD, BAD], [1, 0.3, 0.1, 0.1], []),
            ([OK] * 5 + [BAD] * 12, [1] * 5 + [0.1] * 12, []),
            ([BAD], [0.0], []),
            ([OK] * 8 + [BAD] * 4, [1] * 8 + [0.4, 0.3, 0.2, 0.1], [[11], [10], [9]]),
            ([OK] * 8 + [BAD] * 6, [1] * 8 + [0.5, 0.4, 0.3, 0.2, 0.1, 0], [[13, 12, 11, 10, 9, 8]]),
        ],
    )
    def test_sets_of_grains_that_may_be_missing(self, statuses, supports, expected):
        sets = suspects(classified(statuses), np.array(supports, dtype=float))
        assert [list(rows) for rows in sets] == expected

    @pytest.mark.parametrize(("gain", "number"), [(0.8, 4), (1.0, 0), (0.3, 0), (-0.2, 0), (1.2, 0)])
    def test_each_grain_is_a_suspect_if_attenuation_is_lacking(self, gain, number):
        """Most are not converged: one absent grain may disturb all, if the gain is below one."""
        measured = classified([OK, BAD, BAD, BAD])
        lacking = replace(measured, fit=replace(measured.fit, gain=gain))
        assert [list(rows) for rows in suspects(lacking, np.ones(4))] == [[k] for k in range(number)]

    def test_fewer_failures_or_a_much_lower_cost_are_an_improvement(self):
        before = classified([OK, BAD, BAD], 0.1)
        assert improves(classified([OK, OK], 0.3), before)
        assert improves(classified([OK, BAD], 0.05), before)
        assert not improves(classified([OK, BAD], 0.09), before)
        assert not improves(classified([BAD, BAD], 0.01), before)


class TestComplete:
    def test_rows_are_in_the_order_of_the_grains(self):
        grains = replace(grain_set(), grains=tuple(grain_set().grains[k] for k in (3, 0, 4, 1, 2)))
        rest = grains.without([2])
        measured = replace(
            motions(rest, np.arange(12.0).reshape(4, 3)),
            statuses=np.array(["converged", "converged", "poorly-determined", "converged"]),
            reasons=("", "", "round; look elsewhere", ""),
            fit=StateFit(1.1, 0.2),
        )
        completed = complete(measured, grains)
        np.testing.assert_array_equal(completed.labels, [4, 1, 5, 2, 3])
        np.testing.assert_array_equal(np.delete(completed.translations, 2, axis=0), measured.translations)
        assert np.isnan(completed.translations[2]).all()
        assert np.isnan(completed.rotations[2]).all()
        assert np.isnan(completed.residuals[2])
        assert list(completed.statuses) == ["converged", "converged", "absent", "poorly-determined", "converged"]
        assert completed.reasons[3] == "round; look elsewhere"
        assert ";" in completed.reasons[2]
        assert completed.fit == measured.fit
