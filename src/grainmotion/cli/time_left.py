"""Time left of the work: of the stage in hand by what it has done so far, and of the states by those that are done."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence

from grainmotion.model.progress import without_detail

MIN_SECONDS = 3.0
"""Seconds of a stage before which nothing is said about its end."""
MIN_SHARE_DONE = 0.02
"""Share of a stage before which its speed is not known."""


class TimeLeft:
    """Estimates the time left from messages such as ``"step-01: affine field"`` and the units of work done.

    What stands before the colon is a stage or a state.  A stage's parts do not all take the same time, so that its
    estimate is rough; that of the states is as good as they are alike.
    """

    def __init__(self, states: Sequence[str] = (), clock: Callable[[], float] = time.monotonic) -> None:
        self.states, self.clock = tuple(states), clock
        self.stage, self.started, self.from_share = "", clock(), 0.0
        self.took: dict[str, float] = {}  # seconds of each state that is done
        self.reported, self.share = self.started, 0.0  # when, and what was done by then

    def after(self, message: str, done: int, total: int) -> str:
        """What to say about the time left after this message; empty if too little is known."""
        now, share = self.clock(), done / total if total > 0 else 0.0
        stage = without_detail(message).partition(":")[0]
        if stage != self.stage:
            if self.stage in self.states:
                self.took[self.stage] = now - self.started
            self.stage, self.started, self.from_share = stage, now, share
        elif share < self.share:  # it begins anew
            self.started, self.from_share = now, share
        self.reported, self.share = now, share
        return self.now()

    def now(self) -> str:
        """The same at this moment, counted down since the last message."""
        now = self.clock()
        parts = [self._of_stage(now), self._of_states(now - self.started)]
        return ", ".join(part for part in parts if part)

    def _of_stage(self, now: float) -> str:
        elapsed, gained = self.reported - self.started, self.share - self.from_share
        if now - self.started < MIN_SECONDS or gained < MIN_SHARE_DONE or self.share >= 1:
            return ""
        seconds = elapsed / gained * (1 - self.share) - (now - self.reported)
        return f"about {duration(seconds)} left" if seconds > 0 else "longer than expected"

    def _of_states(self, elapsed: float) -> str:
        if self.stage not in self.states or not self.took:
            return ""
        mean = sum(self.took.values()) / len(self.took)
        more = len(self.states) - self.states.index(self.stage) - 1
        if not more or mean < MIN_SECONDS:
            return ""
        seconds = mean * more + max(0.0, mean - elapsed)
        return f"about {duration(seconds)} for this and {more} more state{'s' * (more > 1)}"


def duration(seconds: float) -> str:
    """Seconds as a person says them: ``8 s``, ``1 min 20 s``, ``12 min``, ``3 h 5 min``."""
    whole = max(1, round(seconds))
    if whole < 60:
        return f"{whole} s"
    minutes, rest = divmod(whole, 60)
    if minutes < 5:
        return f"{minutes} min" + (f" {rest} s" if rest else "")
    minutes = round(whole / 60)
    hours, minutes = divmod(minutes, 60)
    return f"{minutes} min" if not hours else f"{hours} h" + (f" {minutes} min" if minutes else "")
