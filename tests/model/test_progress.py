"""Progress of steps by calls, of loops inside them by `counted`; where nobody listens nothing happens."""

import threading

import numpy as np
import pytest

from grainmotion.model import progress
from grainmotion.model.progress import SHARES, Listener, begin, counted, detail, listening, reached, without_detail


@pytest.fixture
def reports(monkeypatch):
    """What is reported inside, without a limit of reports a second."""
    monkeypatch.setattr(progress, "MIN_INTERVAL", 0.0)
    told = []
    with listening(lambda *report: told.append(report)):
        yield told


def shares(reports):
    return [round(done / total, 3) for _, done, total in reports]


def test_a_loop_reports_the_share_of_its_step(reports):
    begin("reading", 1, 2)
    assert list(counted("abcd")) == list("abcd")
    assert [message for message, *_ in reports] == ["reading"] * 5
    assert shares(reports) == [0.5, 0.5, 0.625, 0.75, 0.875]


def test_loops_in_a_loop_share_its_turns(reports):
    begin("step")
    for _ in counted(range(2)):
        for _ in counted(np.zeros((2, 3))):
            pass
    assert shares(reports) == [0, 0, 0, 0.25, 0.5, 0.5, 0.75]


def test_a_step_never_goes_back(reports):
    begin("step")
    for _ in range(2):
        list(counted(range(2)))
    assert shares(reports) == [0, 0, 0.5, 0.5, 0.5]


def test_steps_inside_a_loop(reports):
    """As of a stage whose rounds tell their own steps: loops below share the step that was told last."""
    for k in counted(range(2)):
        begin(f"round {k}", k, 2)
        list(counted(range(2)))
    assert [m for m, *_ in reports] == ["", "round 0", "round 0", "round 0", "round 0", "round 1", "round 1", "round 1"]
    assert shares(reports) == [0, 0, 0, 0.25, 0.25, 0.5, 0.5, 0.75]


def test_parts_of_a_step_are_in_brackets(reports):
    begin("checking the grains")
    for k, what in enumerate(("sizes", "shapes")):
        detail(what, k, 2)
        list(counted(range(2)))
    assert reports[1][0] == "checking the grains (sizes)"
    assert without_detail(reports[1][0]) == "checking the grains"
    assert shares(reports) == [0, 0, 0, 0.25, 0.5, 0.5, 0.75]


def test_the_width_of_a_step_follows_from_the_one_before(reports):
    """As of updates of 20 views each: the loops of the next one lead to 60 of 100."""
    begin("updates", 20, 100)
    begin("updates", 40, 100)
    list(counted(range(2)))
    assert reports[-1] == ("updates", SHARES * 50, SHARES * 100)


def test_smaller_steps_than_the_one_before_do_not_go_back(reports):
    for done in (0, 50, 75, 80):
        begin("steps", done, 100)
        list(counted(range(2)))
    told = shares(reports)
    assert told == sorted(told)
    assert told[-1] == 0.875
    begin("steps again", 10, 100)
    assert shares(reports)[-1] == 0.1


def test_without_a_length_the_step_lives_without_a_share(reports):
    begin("step")
    assert list(counted(iter("ab"))) == ["a", "b"]
    assert shares(reports) == [0, 0, 0]
    assert list(counted(iter("ab"), 2)) == ["a", "b"]
    assert shares(reports) == [0, 0, 0, 0, 0.5]


def test_few_reports_of_quick_loops():
    told = []
    with listening(lambda *report: told.append(report)):
        begin("step")
        list(counted(range(100_000)))
    assert len(told) < 100


def test_nobody_listens():
    begin("step")
    detail("part")
    assert list(counted(range(3))) == [0, 1, 2]


def test_other_threads_do_not_report(reports):
    thread = threading.Thread(target=lambda: list(counted(range(3))))
    thread.start()
    thread.join()
    assert not reports


@pytest.mark.parametrize("leave", ["break", "error"])
def test_a_loop_that_is_left(reports, leave):
    begin("step")
    try:
        for k in counted(range(4)):
            if k == 2:
                if leave == "break":
                    break
                raise ValueError
    except ValueError as error:
        kept = error  # with the frames of the loop
        assert kept
    list(counted(range(4)))
    assert shares(reports)[-1] == 0.75


def test_an_error_leaves_no_listener_behind():
    told = []
    kept = None
    try:
        with listening(lambda *report: told.append(report)):
            for _ in counted(range(4)):
                raise ValueError
    except ValueError as error:
        kept = error
    del kept
    told.clear()
    list(counted(range(3)))
    assert not told


def test_one_listener_is_not_put_into_another():
    with listening(lambda *_: None) as outer, listening(outer) as inner:
        assert isinstance(outer, Listener)
        assert inner is outer
    with listening(None) as nobody:
        assert nobody is None


def test_what_follows_begins_anew(reports):
    """As reading of a volume, and then the cutting of its grains: each is one step of its own."""
    for message in ("reading", "cutting"):
        begin(message)
        list(counted(range(2)))
    assert shares(reports) == [0, 0, 0.5] * 2


def test_a_loop_of_unknown_length_tells_how_far_it_has_come(reports):
    begin("solving")
    for _ in counted(range(2)):
        for number in (1, 3):
            reached(number / (number + 1))
    assert shares(reports) == [0, 0, 0.25, 0.375, 0.5, 0.75, 0.875]


def test_nothing_happens_where_nobody_listens():
    reached(0.5)
