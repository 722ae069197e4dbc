"""Colours, and what changes them: `--color`, NO_COLOR, FORCE_COLOR, TERM=dumb, and whether a terminal is there."""

import io
import sys

import pytest

from grainmotion.cli.interrupts import Stop
from grainmotion.cli.progress import _draws_bars, progress
from grainmotion.cli.terminal import Terminal

COLOR_VARIABLES = ("NO_COLOR", "FORCE_COLOR", "TERM", "COLORTERM", "TTY_COMPATIBLE", "TTY_INTERACTIVE")
ESCAPE = "\x1b"


class Screen(io.StringIO):
    """A stream that says whether it is a terminal."""

    def __init__(self, is_terminal):
        super().__init__()
        self.is_terminal = is_terminal

    def isatty(self):
        return self.is_terminal


@pytest.fixture
def shown(monkeypatch):
    """What a warning looks like on a stream, with an environment and a value of `--color`."""

    def show(color="auto", terminal=True, **variables):
        for name in COLOR_VARIABLES:
            monkeypatch.delenv(name, raising=False)
        for name, value in {"TERM": "xterm-256color", **variables}.items():
            monkeypatch.setenv(name, value)
        screen = Screen(terminal)
        monkeypatch.setattr(sys, "stderr", screen)
        Terminal(color=color).note("error: the door is open; close it")
        return screen.getvalue()

    return show


PLAIN = "error: the door is open; close it\n"


class TestAuto:
    def test_colours_on_a_terminal_only(self, shown):
        assert ESCAPE in shown()
        assert shown(terminal=False) == PLAIN

    def test_no_color(self, shown):
        assert shown(NO_COLOR="1") == PLAIN

    def test_an_empty_no_color_is_none(self, shown):
        assert ESCAPE in shown(NO_COLOR="")

    def test_force_color(self, shown):
        assert ESCAPE in shown(terminal=False, FORCE_COLOR="1")

    def test_a_dumb_terminal(self, shown):
        assert shown(TERM="dumb") == PLAIN


class TestOption:
    @pytest.mark.parametrize("variables", [{}, {"FORCE_COLOR": "1"}])
    @pytest.mark.parametrize("terminal", [True, False])
    def test_never(self, shown, terminal, variables):
        assert shown("never", terminal, **variables) == PLAIN

    @pytest.mark.parametrize("variables", [{}, {"NO_COLOR": "1"}, {"TERM": "dumb"}])
    @pytest.mark.parametrize("terminal", [True, False])
    def test_always(self, shown, terminal, variables):
        assert ESCAPE in shown("always", terminal, **variables)


def test_no_bar_on_a_dumb_terminal_or_a_file(monkeypatch):
    monkeypatch.setattr(sys, "stderr", Screen(True))
    monkeypatch.setenv("TERM", "xterm")
    assert _draws_bars()
    monkeypatch.setenv("TERM", "dumb")
    assert not _draws_bars()
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setattr(sys, "stderr", Screen(False))
    assert not _draws_bars()


class TestBesideABar:
    def say(self, monkeypatch, stdout, stderr):
        for name in COLOR_VARIABLES:
            monkeypatch.delenv(name, raising=False)
        monkeypatch.setenv("TERM", "xterm")
        monkeypatch.setattr(sys, "stdout", stdout)
        monkeypatch.setattr(sys, "stderr", stderr)
        with progress(Terminal(), Stop()) as listen:
            listen("waiting for radiographs", 0, 2)
            Terminal().say("one: tracked")

    def test_a_result_stands_above_the_bar(self, monkeypatch):
        screen = Screen(is_terminal=True)
        self.say(monkeypatch, screen, screen)
        assert "\x1b[2Kone: tracked\n" in screen.getvalue()  # the line of the bar is cleared first

    def test_a_result_goes_to_the_file_that_standard_output_is(self, monkeypatch):
        file, screen = Screen(is_terminal=False), Screen(is_terminal=True)
        self.say(monkeypatch, file, screen)
        assert file.getvalue() == "one: tracked\n"
        assert "tracked" not in screen.getvalue()
