"""The study of wrong input (`validation.accuracy.wrong_input`): a few of its trials, and its tables."""

from __future__ import annotations

import re
import tomllib

import numpy as np
import pytest
from validation.accuracy.page import PAGE
from validation.accuracy.wrong_input import measure, tables
from validation.accuracy.wrong_input.draft import Draft, toml
from validation.accuracy.wrong_input.laboratory import VOXEL, Recipe, laboratory
from validation.accuracy.wrong_input.rows import ROWS, Row
from validation.accuracy.wrong_input.trial import good, load, save, wrong
from validation.accuracy.wrong_input.verdicts import Verdict
from validation.common.page import Page


@pytest.fixture(scope="module", autouse=True)
def own_cache(tmp_path_factory):
    """Nothing is read from, or left in, the results of the study."""
    with pytest.MonkeyPatch.context() as patch:
        folder = tmp_path_factory.mktemp("cache")
        patch.setattr(Page, "cache", property(lambda page: folder / page.name))
        yield


def verdict(*lines: str, wrong: int = 0, converged: int = 5, stopped: bool = False) -> Verdict:
    return Verdict(list(lines), stopped, converged, wrong, 0, 0, (0.0, 0.0), 1.0)


def row(cause: str = r"error.*angles", beams: tuple[str, ...] = ("cone", "parallel")) -> Row:
    return Row("a-row", "silent", "wrong angles", "mirrored", cause, "`views`", lambda draft: None, beams)


class TestTrials:
    @pytest.mark.parametrize(("name", "seed"), [("end-point-counted", 0), ("volume-upside-down", 1)])
    def test_a_mistake_is_named(self, name, seed):
        found = wrong(name, seed)
        assert ROWS[name].named(found)
        assert found.stopped

    def test_a_right_volume_is_tracked_without_a_word(self):
        found = good("volume", 2)
        assert found.told == []
        assert found.right

    def test_a_misspelled_setting_is_refused(self):
        assert "unknown setting" in wrong("settings-misspelled", 3).lines[0]

    def test_verdicts_are_kept(self, tmp_path):
        one = verdict("note: something", wrong=2)
        save(tmp_path / "some" / "3.json", one)
        assert load(tmp_path / "some" / "3.json").lines == one.lines


class TestLaboratory:
    def test_seeds_differ_in_beam_and_sample(self):
        cone, parallel = (laboratory(Recipe(seed)) for seed in (0, 1))
        assert (cone.beam, parallel.beam) == ("cone", "parallel")
        assert not np.array_equal(cone.sample.centers[:5], parallel.sample.centers[:5])

    def test_the_stage_rises_in_the_full_scan_alone(self):
        lab = laboratory(Recipe(0, rise=4 * VOXEL))
        full, state = lab.geometry(lab.angles_deg), lab.geometry(lab.state_angles_deg)
        assert np.ptp(full.detector[:, 2]) == pytest.approx(4 * VOXEL)
        assert np.ptp(state.detector[:, 2]) == 0

    def test_tables_as_toml(self):
        keys = Draft.of(Recipe(0)).keys
        read = tomllib.loads(toml(keys))
        assert read["reference"]["geometry"] == keys["reference.geometry"]
        assert read["states"] == [keys["states"]]


class TestTables:
    def test_only_what_names_the_cause_is_named(self):
        found = {0: verdict("error: wrong angles"), 1: verdict("warning: something"), 2: verdict(wrong=3)}
        cells = tables.cells(row(), found)
        assert cells[2:6] == ["1 of 3 (cone 1 of 2, parallel 0 of 1)", "2 of 3", "1", "2 right, 1 wrong"]

    def test_rows_of_one_beam_have_seeds_of_that_beam(self):
        assert row(beams=("cone",)).seeds(3) == [0, 2, 4]
        assert row(beams=("parallel",)).seeds(3) == [1, 3, 5]

    def test_all_rows_are_in_one_of_the_tables(self):
        assert len(measure.rows()) == len(ROWS)
        assert {r.group for r in measure.rows()} == set(tables.TITLES)

    def test_the_page_has_the_rows_of_the_study(self):
        text = PAGE.path.read_text()
        section = text[text.index("<!-- begin wrong_input -->") : text.index("<!-- end wrong_input -->")]
        inputs = re.findall(r"^\| (.*?) \| .*\d+ of \d+.* \|$", section, re.MULTILINE)
        assert sorted(inputs) == sorted(r.text for r in measure.rows())
