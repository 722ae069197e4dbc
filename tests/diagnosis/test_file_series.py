"""Findings from the names of files: gaps, strangers, order, angles; none about good series."""

import numpy as np
import pytest

from grainmotion.diagnosis.file_series import count_hint, listed_order, series_findings
from grainmotion.model.finding import Level

ANGLES = np.arange(60) * 6.0
NAMES = [f"proj_{k:04d}.tif" for k in range(60)]


def facts(names, angles=None, elsewhere=()):
    return [str(f) for f in series_findings("reference.radiographs", names, angles, elsewhere)]


class TestGoodSeriesGiveNoFinding:
    @pytest.mark.parametrize(
        "names",
        [
            NAMES,
            [f"p_{3 * k}.tif" for k in range(60)],
            [f"2024-05-12_{101500 + 7 * k + k % 3}_{k:04d}.tif" for k in range(60)],
            [f"2024-05-12 10.15.{k:02d}.tif" for k in range(60)],
            [f"slice-{k}_bin2.tif" for k in range(60)],
            ["front.tif", "side.tif", "oblique.tif", "back.tif"],
            ["p_0.tif", "p_17.tif", "p_30.tif", "p_45.tif"],
            [f"raw_{k:05d}.tif" for k in (11, 33, 55, 77)],
            ["one.tif"],
            [f"img_10{15 + k // 6}{10 * (k % 6):02d}.tif" for k in range(60)],
            [f"img_2024051210{15 + k // 12}{5 * (k % 12):02d}.tif" for k in range(60)],
        ],
    )
    def test_usual_names(self, names):
        assert facts(names) == []
        assert facts(names, ANGLES[: len(names)]) == []

    def test_interlaced_angles_in_names(self):
        angles = np.concatenate([ANGLES[::2], ANGLES[1::2]])
        assert facts([f"p_{k:03d}_{a:05.1f}.tif" for k, a in enumerate(angles)], angles) == []

    def test_random_names(self):
        rng = np.random.default_rng(0)
        assert facts([f"{rng.integers(1 << 60):x}.tif" for _ in range(60)]) == []

    @pytest.mark.parametrize("skipped", [[20], [20, 40], [30, 31]])
    def test_numbers_of_flats_taken_in_between(self, skipped):
        names = [n for k, n in enumerate(NAMES) if k not in skipped]
        assert facts(names, ANGLES[: len(names)], [NAMES[k] for k in skipped]) == []

    @pytest.mark.parametrize("skipped", [[17], [17, 40], [30, 31]])
    def test_views_left_out_with_their_angles(self, skipped):
        kept = [k for k in range(60) if k not in skipped]
        assert facts([NAMES[k] for k in kept], ANGLES[kept]) == []

    def test_angles_in_names_rounded_or_a_turn_further(self):
        angles = np.arange(60) * 6.25
        assert facts([f"p_{a:.1f}.tif" for a in angles], angles) == []
        assert facts([f"p_{a:.1f}.tif" for a in angles], angles - 360) == []


@pytest.mark.parametrize("skipped", [[17], [1], [6], [53], [58], [17, 40], [30, 31], [10, 20, 30]])
def test_gap_is_named(skipped):
    names = [n for k, n in enumerate(NAMES) if k not in skipped]
    (fact,) = facts(names, np.linspace(0, 354, len(names)))
    assert f"{NAMES[skipped[0]]}" in fact
    assert f"follows {NAMES[skipped[0] - 1]}" in fact
    assert facts(names) == [fact]


def test_gap_is_named_though_flats_have_that_number():
    """They are counted from 0, too, so that the counter is not common to both."""
    names = [n for k, n in enumerate(NAMES) if k != 6]
    (fact,) = facts(names, np.linspace(0, 354, 59), NAMES[:10])
    assert NAMES[6] in fact


def test_counter_that_began_again():
    (fact,) = facts([f"IMG_{k:04d}.tif" for k in [*range(1, 30), *range(9980, 9999)]])
    assert "the numbers of the files jump" in fact
    assert "IMG_9980.tif follows IMG_0029.tif" in fact


@pytest.mark.parametrize("stranger", ["preview.tif", "proj_0003_copy.tif", "flat_0001.tif", "proj_thumb.tif"])
def test_stranger_is_named(stranger):
    fact = facts([*NAMES, stranger])[0]
    assert f"{stranger} is named unlike the other files" in fact
    assert "proj_*.tif" in fact


def test_two_series_of_one_size_are_noted():
    (finding,) = series_findings("a", [f"{s}_{k:03d}.tif" for s in ("day1", "night1") for k in range(30)], None)
    assert finding.level is Level.NOTE
    assert "day#_#.tif and night#_#.tif" in finding.fact


def test_files_of_one_number():
    assert any("p_1.tif and p_01.tif have the same number" in f for f in facts(["p_1.tif", "p_01.tif", "p_02.tif"]))


ANGLE_NAMES = [f"proj_{a:.1f}.tif" for a in ANGLES - 180]


class TestAnglesInNames:
    def test_another_order_is_an_error(self):
        told = np.concatenate([ANGLES[::2], ANGLES[1::2]]) - 180
        (finding,) = series_findings("reference.radiographs", ANGLE_NAMES, told)
        assert finding.level is Level.ERROR
        assert "in another order" in finding.fact

    def test_other_values(self):
        (finding,) = series_findings("reference.radiographs", ANGLE_NAMES, np.linspace(0, 180, 60))
        assert finding.level is Level.WARNING
        assert "-180, -174" in finding.evidence

    def test_other_sign_and_other_start_are_noted(self):
        for told, word in ((180 - ANGLES + 1e-9, "other sign"), (ANGLES + 33, "begin elsewhere")):
            (finding,) = series_findings("reference.radiographs", ANGLE_NAMES, told)
            assert finding.level is Level.NOTE
            assert word in finding.fact


def test_list_sorted_as_text():
    names = sorted(f"p_{k}.tif" for k in range(20))
    (finding,) = listed_order("reference.radiographs", names)
    assert "p_0.tif, p_1.tif, p_10.tif, p_11.tif" in finding.evidence
    (finding,) = listed_order("reference.radiographs", [*NAMES[:4], NAMES[2]])
    assert "proj_0002.tif is listed more than once" in finding.fact
    assert listed_order("reference.radiographs", NAMES) == ()
    assert listed_order("reference.radiographs", [NAMES[k] for k in (3, 1, 2)]) == ()


class TestCountHint:
    def test_missing_files(self):
        assert "proj_0017.tif" in count_hint(NAMES[:17] + NAMES[18:], 60, (59, 4, 5), ANGLES)

    def test_strangers(self):
        assert "preview.tif is named unlike" in count_hint([*NAMES, "preview.tif"], 60, (61, 4, 5), ANGLES)

    def test_sinograms(self):
        assert "its second axis has 60: sinograms?" in count_hint(["scan.npy"], 60, (40, 60, 50), ANGLES)

    def test_end_point(self):
        assert "one direction: leave out the last" in count_hint(NAMES, 61, (60, 4, 5), np.linspace(0, 360, 61))
        assert "end point" in count_hint(NAMES, 61, (60, 4, 5), np.linspace(0, 180, 61))

    def test_flats_among_them(self):
        assert "flats or darks" in count_hint(["scan.npy"], 60, (80, 40, 50), ANGLES)


def random_series(rng):
    """Names of a series as a scanner may write it, and the step and first number of its counter."""
    count, start, step = int(rng.integers(20, 400)), int(rng.integers(0, 3)), int(rng.choice([1, 1, 1, 2, 5]))
    digits = int(rng.choice([0, 4, 6]))
    prefix = rng.choice(["proj_", "scan-", "2024-05-12_sample 3_", "IMG", "a.b_", "tomo_bin2_r"])
    return [f"{prefix}{start + step * k:0{max(digits, 1)}d}{rng.choice(['.tif'])}" for k in range(count)]


def test_gaps_are_found_in_any_series_and_only_there():
    """20 seeds: all gaps named, no finding without one."""
    for seed in range(20):
        rng = np.random.default_rng(seed)
        names = random_series(rng)
        told = np.arange(len(names)) * 180.0 / len(names)
        assert facts(names, told) == [], seed
        lost = int(rng.integers(1, len(names) - 1))
        kept = names[:lost] + names[lost + 1 :]
        (fact,) = facts(kept, told[:-1])
        assert f"{names[lost]} is not there" in fact, seed
        hint = count_hint(kept, len(names), (len(kept), 40, 50), told)
        assert names[lost] in hint, seed
