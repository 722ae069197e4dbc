"""Scores of laboratory samples (`validation.accuracy.laboratory_scores`), and their section of the page."""

import dataclasses

import numpy as np
import pytest
from validation.accuracy import laboratory, page
from validation.accuracy.laboratory import Outcome
from validation.accuracy.laboratory_scores import BARS, Bar, Score, coverage, score, shortfalls
from validation.common.page import Page

from grainmotion.model.motions import Status
from grainmotion.simulate import hard_case


@pytest.fixture(scope="module")
def gone():
    return hard_case("gone", seed=3)


def measured(case, **changes):
    """The truth as a measurement with standard deviations of 0.01 voxel and 0.1°; missing grains are absent."""
    truth, h = case.motions, case.case.scanner.voxel_size
    sd = np.array([0.01 * h] * 3 + [np.deg2rad(0.1)] * 3)
    columns = {
        "translations": np.nan_to_num(truth.translations),
        "rotations": np.nan_to_num(truth.rotations),
        "covariances": np.tile(np.diag(sd**2), (len(truth), 1, 1)),
    }
    return dataclasses.replace(truth, **{**columns, **changes})


class TestScore:
    def test_the_truth_reaches_the_bar(self, gone):
        one = score(gone, measured(gone), 4)
        assert (one.found, one.present, one.whole, one.wanted, one.absent) == (9, 6, 6, 0, (3, 3))
        assert one.statuses == {"converged": 6, "absent": 3}
        assert np.abs(one.errors).max() < 1e-9
        np.testing.assert_allclose(one.sds, np.tile([0.01] * 3 + [0.1] * 3, (6, 1)))
        assert shortfalls(BARS["gone"], [one]) == []

    def test_a_converged_grain_that_is_missing_is_a_lie(self, gone):
        statuses = np.full(9, Status.CONVERGED.value, dtype="<U20")
        one = score(gone, measured(gone, statuses=statuses), 4)
        assert one.absent == (0, 3)
        assert sorted(one.lies) == [f"grain {label} is missing" for label in gone.missing]
        assert shortfalls(BARS["gone"], [one]) == ["3 lies", "3 missing ones not absent"]

    def test_an_error_of_many_standard_deviations_is_a_lie(self, gone):
        row = next(k for k in range(9) if k + 1 not in gone.missing)
        translations = np.nan_to_num(gone.motions.translations)
        translations[row, 0] += 0.2 * gone.case.scanner.voxel_size
        one = score(gone, measured(gone, translations=translations), 4)
        assert one.lies == [f"grain {row + 1}: 0.20 voxel, 0.0°"]
        translations[row, 0] -= 0.11 * gone.case.scanner.voxel_size
        assert score(gone, measured(gone, translations=translations), 4).lies == []

    def test_a_converged_grain_far_from_all_is_a_lie(self, gone):
        row = next(k for k in range(9) if k + 1 not in gone.missing)
        centers = gone.motions.centers.copy()
        centers[row, 2] += 5 * gone.case.scanner.voxel_size
        one = score(gone, measured(gone, centers=centers), 4)
        assert one.lies == [f"label {row + 1} is no grain"]
        assert one.wanted == 1

    def test_only_dense_grains_count_where_there_are_two_materials(self):
        case = hard_case("materials", seed=3)
        one = score(case, measured(case), 4)
        assert one.counted.sum() == 4
        assert len(one.errors) == 8

    def test_only_whole_grains_must_converge_where_the_panel_cuts_some(self):
        case = hard_case("tall", seed=3)
        statuses = np.where(case.whole(), "converged", "cut").astype("<U20")
        one = score(case, measured(case, statuses=statuses), 4)
        assert 0 < one.whole < one.present == 20
        assert shortfalls(BARS["tall"], [one]) == []


class TestBars:
    def test_bars_in_words(self):
        assert str(Bar(0.02, 0.2)) == "all converged, 0.02 voxel, 0.2°"
        assert str(Bar(converged="any")) == "no lie"

    def test_shortfalls_are_named(self):
        errors, sds = np.full((10, 6), 0.03), np.full((10, 6), 0.01)
        bad = Score(
            found=12, present=11, rows=np.arange(10), errors=errors, sds=sds, counted=np.ones(10, bool), wanted=1
        )
        assert shortfalls(Bar(0.02, 0.2, note="creep"), [bad, Score(error="it broke")]) == [
            "1 of 2 runs failed", "1 not converged", "1 spurious", "0.030 voxel", "coverage 0%",
            "no note",
        ]  # fmt: skip

    def test_coverage_is_the_share_within_its_interval(self):
        rng = np.random.default_rng(1)
        assert coverage(rng.normal(size=(5000, 6)), np.ones((5000, 6))) == pytest.approx(0.95, abs=0.005)


class TestPage:
    def test_a_failed_run_is_a_row(self):
        failed = Outcome(Score(present=20, whole=20, error="InputError: no grain"), np.full((20, 6), np.nan))
        text = laboratory.section({"wet": {4: [failed], 2: [failed]}}).text
        assert "| wet | 4 | 20 (20) | 0 | – | – | – | – | – | – | – | 0 |" in text
        assert "1 of 1 runs failed" in text
        assert "- *wet*, 2 views, seed 3: InputError: no grain" in text

    def test_an_exception_is_an_outcome(self, monkeypatch, tmp_path):
        monkeypatch.setattr(Page, "cache", property(lambda self: tmp_path))
        monkeypatch.setattr(laboratory, "compile_kernels", lambda: None)
        monkeypatch.setattr(laboratory, "made", lambda name, seed: hard_case("combined", seed))
        monkeypatch.setattr(laboratory, "reference", lambda name, seed: 1 / 0)
        one = laboratory.outcome("combined", 3, 4)
        assert one.error.startswith("ZeroDivisionError")
        assert (one.found, one.present, one.whole) == (0, 6, 6)
        assert page.PAGE.path.name == "accuracy.md"

    def test_bounds_are_of_the_grains_that_are_there(self, monkeypatch, tmp_path, gone):
        monkeypatch.setattr(Page, "cache", property(lambda self: tmp_path))
        monkeypatch.setattr(laboratory, "made", lambda name, seed: gone)
        least = laboratory.bounds("gone", 3, 2)
        assert np.isnan(least).all(axis=1).sum() == 3
        there = least[~np.isnan(least).any(axis=1)]
        assert 0.002 < there[:, :3].mean() < 0.02
        assert np.isnan(laboratory.bounds("soft", 3, 2)).all()
