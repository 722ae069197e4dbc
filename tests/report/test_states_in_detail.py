"""Which states of a long series the page holds in full, and that it tells."""

from dataclasses import replace

import example
import numpy as np
import pytest

from grainmotion.report import ReportData, states_in_detail, write_report


def series(states: int) -> ReportData:
    one = example.state("s", shape=(1, 4, 5))
    return replace(example.data(), states=tuple(replace(one, name=f"s{k}") for k in range(states)))


@pytest.mark.parametrize(
    ("rows", "most", "expected"), [(60_000, 1, 30), (60, 1, 10), (1, 60_000, 4), (1, 18, 3), (1, 1, 2)]
)
def test_states_are_spread_evenly_within_the_limits(monkeypatch, rows, most, expected):
    monkeypatch.setattr(states_in_detail, "MAX_ROWS", rows)
    monkeypatch.setattr(states_in_detail, "MOST_ROWS", most)
    monkeypatch.setattr(states_in_detail, "FEW_STATES", 4)
    shown = states_in_detail.states_in_detail(series(30))
    assert len(shown) == expected
    assert (shown[0], shown[-1]) == (0, 29)
    steps = np.diff(shown)
    assert max(steps) - min(steps) <= 1


def test_no_state_is_no_state():
    assert states_in_detail.states_in_detail(series(0)) == []


def test_page_names_all_states_and_says_which_are_left_out(monkeypatch, tmp_path):
    monkeypatch.setattr(states_in_detail, "MAX_STATES", 3)
    write_report(tmp_path / "report.html", series(8))
    text = " ".join((tmp_path / "report.html").read_text(encoding="utf-8").split())
    assert "shows 3 of 8 states in detail" in text
    assert text.count('<th scope="row">') == 8
    assert text.count('class="link" data-state=') == 3
    assert '"state_numbers":[1,5,8]' in text or '"state_numbers":[1,4,8]' in text
