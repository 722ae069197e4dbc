"""The accuracy studies (`validation.accuracy`) at their smallest size, and their pages."""

import dataclasses

import numpy as np
import pytest
from validation.accuracy import coverage, full_scans, hard_cases, limits, outcomes, page, projectors, specimens
from validation.accuracy.remedies import DEFAULT, REMEDIES, Remedy, remedies
from validation.accuracy.specimens import Specimen
from validation.common import cache
from validation.common.page import Page, Section

from grainmotion.model.motions import Status
from grainmotion.simulate import HARD_CASES

CONVERGED = Status.CONVERGED.value
FEW = Specimen(grains=3)


@pytest.fixture(scope="module", autouse=True)
def own_cache(tmp_path_factory):
    """Nothing is read from, or left in, the cache of the studies."""
    with pytest.MonkeyPatch.context() as patch:
        folder = tmp_path_factory.mktemp("cache")
        patch.setattr(Page, "cache", property(lambda page: folder / page.name))
        yield


def outcome_of(errors, sds, statuses=None, **changes):
    """An outcome of a few grains."""
    n = len(errors)
    plain = outcomes.Outcome(
        labels=list(range(1, n + 1)),
        statuses=statuses or [CONVERGED] * n,
        reasons=[""] * n,
        errors=np.asarray(errors, dtype=float).tolist(),
        sds=np.asarray(sds, dtype=float).tolist(),
        failed=[s != CONVERGED for s in statuses or [CONVERGED] * n],
        spurious=0,
        notes=[],
        cpu=1.0,
    )
    return dataclasses.replace(plain, **changes)


class TestOutcomes:
    def test_wrong_grains_exceed_their_sd_and_a_fixed_limit(self):
        sd = np.full(6, 0.01)
        rows = np.zeros((5, 6))
        rows[0, 1], rows[1, 4] = 0.31, 2.1  # wrong: translation, rotation
        rows[2, 0], rows[2, 5] = 0.29, 1.9  # far beyond its sd, but within the fixed limit
        rows[3, 2], rows[4, 2] = 0.4, 9.0  # within 5 sd; not converged
        sds = np.stack([sd, sd, sd, np.full(6, 0.1), sd])
        statuses = [CONVERGED] * 4 + [Status.NOT_CONVERGED.value]
        assert outcomes.pool([outcome_of(rows, sds, statuses)]).wrong == 2

    def test_errors_are_those_of_converged_grains(self):
        one = outcome_of([[0.3] * 3 + [2.0] * 3, [9.0] * 6], np.ones((2, 6)), [CONVERGED, "not-converged"], spurious=1)
        pooled = outcomes.pool([one])
        assert pooled.rms == pytest.approx((0.3, 2.0))
        assert pooled.over_sd == pytest.approx((0.3, 2.0))
        assert pooled.failures == 2
        assert pooled.counts() == "1 converged, 1 not-converged"

    def test_marked_grains_are_left_out(self):
        one = outcome_of([[1.0] * 6, [9.0] * 6], np.ones((2, 6)))
        assert outcomes.pool([one, one], [(2,), (1,)]).rms == pytest.approx((np.sqrt(41), np.sqrt(41)))

    def test_grains_missing_from_the_reference(self):
        truth = specimens.case(FEW).motions["random"]
        measured = dataclasses.replace(
            truth, **{name: getattr(truth, name)[1:] for name in outcomes_columns()}, fit=truth.fit
        )
        result = outcomes.outcome(measured, truth, 0.1, 0.0)
        assert result.statuses == [outcomes.MISSING, CONVERGED, CONVERGED]
        assert np.isnan(result.errors[0]).all()
        assert np.abs(result.errors[1:]).max() < 1e-6

    def test_outcomes_are_cached_with_missing_values(self):
        computed.clear()
        first, second = (cached_outcome(FEW) for _ in range(2))
        assert len(computed) == 1
        assert first.labels == second.labels
        assert np.isnan(second.errors).all()

    def test_outcomes_are_computed_anew_for_other_arguments_or_source(self, monkeypatch):
        computed.clear()
        other = dataclasses.replace(FEW, seed=12)
        cached_outcome(other)
        monkeypatch.setattr(cache, "source_digest", lambda *names: "another")
        cached_outcome(other)
        assert computed == [other, other]


computed = []


@page.PAGE.cached("model")
def cached_outcome(specimen):
    computed.append(specimen)
    return outcome_of([[np.nan] * 6], [[np.nan] * 6])


def outcomes_columns():
    return ("labels", "centers", "translations", "rotations", "covariances", "statuses", "residuals", "iterations",
            "reasons")  # fmt: skip


class TestBounds:
    def test_bounds_fall_with_the_root_of_the_photons(self):
        clean, noisy = specimens.bounds(FEW, "random", 2), specimens.bounds(
            dataclasses.replace(FEW, snr=10.0), "random", 2
        )  # fmt: skip
        photons = [specimens.case(dataclasses.replace(FEW, snr=snr)).physics.photons for snr in (50.0, 10.0)]
        np.testing.assert_allclose(noisy / clean, np.sqrt(photons[0] / photons[1]))
        assert (noisy > 3 * clean).all()

    def test_bounds_fall_with_more_views(self):
        assert (specimens.bounds(FEW, "random", 4) < specimens.bounds(FEW, "random", 2)).mean() > 0.9


class TestStudies:
    def test_errors_over_bounds_of_the_limits_study(self):
        outcome = limits.trial(limits.Trial(FEW, (("random", 4),)))["random", 4]
        u, rotation = limits.over_bounds([outcome])
        assert 0.6 < u < 5
        assert 0.6 < rotation < 6
        assert limits.cells([outcome])[-2] == "0"

    def test_coverage_study(self):
        by_state = coverage.trial(coverage.Trial(FEW, repeats=1))
        pooled = outcomes.pool([o for of_state in by_state.values() for o in of_state])
        assert len(pooled.statuses) == 6
        assert pooled.wrong == 0
        assert coverage.coverage(pooled.ratios) > 0.7

    def test_coverage_of_normal_errors(self):
        rng = np.random.default_rng(0)
        ratios = rng.normal(size=(4000, 6))
        assert coverage.coverage(ratios) == pytest.approx(0.95, abs=0.005)
        assert coverage.coverage(2 * ratios) < 0.7

    def test_projectors_study(self):
        variants = [projectors.VARIANTS[k] for k in (0, 1, 2)]
        by_variant = projectors.trial(projectors.Trial(FEW, tuple(variants)))
        fine, exact, coarse = (limits.over_bounds([by_variant[v.name, 4]]) for v in variants)
        assert fine[1] < coarse[1] < exact[1]
        assert fine[0] < exact[0]

    def test_hard_cases_study(self):
        remedy = REMEDIES["gain-drift-views"][0]
        job = hard_cases.Trial("gain-drift-views", 0, (remedy,))
        pooled = hard_cases.together({job.name: [hard_cases.trial(job)]}, job.name, remedy.name, 4)
        assert pooled.counts() == "6 converged"
        assert pooled.wrong == 0
        assert pooled.rms[0] < 0.02


class TestRemedies:
    def test_remedies_are_of_existing_cases(self):
        assert set(REMEDIES) <= set(HARD_CASES)

    def test_names_are_distinct_and_the_default_comes_first(self):
        for name in HARD_CASES:
            chosen = remedies(name)
            assert chosen[0] == DEFAULT == Remedy("default")
            assert len({r.name for r in chosen}) == len(chosen)
        assert len({v.name for v in projectors.VARIANTS}) == len(projectors.VARIANTS)


class TestPages:
    def test_writing_a_section_replaces_it_and_its_headline(self, tmp_path):
        (tmp_path / "docs").mkdir()
        some_page = Page("some", tmp_path)
        some_page.path.write_text(
            "| a | <!-- headline a --> |\n| b | <!-- headline b --> |\n"
            "<!-- begin a -->\n<!-- end a -->\n<!-- begin b -->\n<!-- end b -->\n"
        )
        some_page.write("b", Section("The b", "other", "kept"))
        for text in ("first", "second"):
            some_page.write("a", Section("The a, at 1 %", text, f"{text} of all"))
        page_text = some_page.path.read_text()
        assert "first" not in page_text
        assert "| [The a, at 1 %](#the-a-at-1-) | second of all <!-- headline a --> |" in page_text
        assert "## The b\n\nother\n\nMade by `python -m validation.some b`." in page_text
        with pytest.raises(ValueError, match="no place for c"):
            some_page.write("c", Section("c", ""))

    def test_the_page_has_a_place_for_every_study(self):
        from validation.accuracy.__main__ import STUDIES

        text = page.PAGE.path.read_text()
        for name in STUDIES:
            assert text.count(f"<!-- begin {name} -->") == text.count(f"<!-- headline {name} -->") == 1

    def test_full_scans_section_has_the_benchmark_s_table(self):
        section = full_scans.section("# Title\n\nwords\n\n| a | b |\n|---|---|\n| 1 | 2 |\n\nMachine.  Made by `it`.\n")
        assert "| 1 | 2 |" in section.text
        assert "Made by `it`;" in section.text

    def test_marked_grains_are_named(self):
        marked = outcome_of(np.zeros((2, 6)), np.ones((2, 6)), ["not-fitted", CONVERGED])
        marked = dataclasses.replace(marked, reasons=["it is missing, 3 of 4", ""])
        unmarked = dataclasses.replace(marked, reasons=["a bad fit", ""])
        trials = {("default", 4): hard_cases.Found(marked, (1,))}, {("default", 4): hard_cases.Found(unmarked, (1,))}
        text = hard_cases.section({"missing": list(trials)}).text
        assert "| missing | default | 4 | 2 not-fitted | 1 of 2 |" in text
        assert "not-fitted: it is missing, … of …" in text


def test_the_digest_changes_with_the_source(tmp_path, monkeypatch):
    (tmp_path / "rays.py").write_text("a = 1")
    monkeypatch.setattr(cache.grainmotion, "__file__", str(tmp_path / "__init__.py"))
    cache.source_digest.cache_clear()
    before = cache.source_digest("rays")
    (tmp_path / "rays.py").write_text("a = 2")
    cache.source_digest.cache_clear()
    assert cache.source_digest("rays") != before
    monkeypatch.undo()
    cache.source_digest.cache_clear()
