"""Time left: by the share of a stage that is done, and by the states that are done."""

import pytest

from grainmotion.cli.time_left import TimeLeft, duration


class Clock:
    now = 0.0

    def __call__(self):
        return self.now


@pytest.fixture
def clock():
    return Clock()


def test_a_stage_of_even_speed(clock):
    left = TimeLeft(clock=clock)
    assert left.after("reconstruct: sweep 1", 0, 100) == ""
    clock.now = 1
    assert left.after("reconstruct: sweep 1", 10, 100) == ""  # too early to tell
    clock.now = 10
    assert left.after("reconstruct: sweep 2", 25, 100) == "about 30 s left"
    clock.now = 40
    assert left.after("reconstruct: sweep 5", 100, 100) == ""


def test_a_stage_that_was_under_way_when_it_was_first_heard_of(clock):
    left = TimeLeft(clock=clock)
    left.after("track: first", 50, 100)
    clock.now = 10
    assert left.after("track: second", 75, 100) == "about 10 s left"


def test_states_by_those_that_are_done(clock):
    left = TimeLeft(("a", "b", "c", "d"), clock)
    left.after("a: one body", 1, 10)
    clock.now = 60
    assert left.after("b: one body", 0, 10) == "about 3 min for this and 2 more states"
    clock.now = 90
    assert "about 2 min 30 s for this and 2 more states" in left.after("b: free", 5, 10)
    assert left.after("d: one body", 0, 10) == ""  # nothing is said of the last


@pytest.mark.parametrize(
    ("seconds", "text"),
    [(0.2, "1 s"), (59, "59 s"), (80, "1 min 20 s"), (120, "2 min"), (700, "12 min"), (11100, "3 h 5 min")],
)
def test_durations(seconds, text):
    assert duration(seconds) == text


def test_time_left_is_counted_down_between_messages(clock):
    left = TimeLeft(clock=clock)
    left.after("segment", 0, 10)
    clock.now = 10
    assert left.after("segment (distances)", 2, 10) == "about 40 s left"
    clock.now = 25
    assert left.now() == "about 25 s left"
    clock.now = 60
    assert left.now() == "longer than expected"
    assert left.after("segment", 1, 10) == ""  # it goes back: a loop of the same stage begins anew
