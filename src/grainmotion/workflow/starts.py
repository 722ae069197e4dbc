"""From which motions each state of a run starts: the states that it waits for, and what they tell of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from grainmotion.experiment.scan_tables import StateTable
from grainmotion.model.motions import Motions
from grainmotion.sequences.extrapolation import extrapolate


@dataclass(frozen=True)
class StateStart:
    """What a state that starts from the state before it waits for.

    ``previous`` is the state before it and ``earlier`` the one before that, None for the reference; ``ratio`` is the
    time from the former to this state over that between the two, 1 where times are not told.
    """

    previous: str
    earlier: str | None
    ratio: float

    @property
    def after(self) -> tuple[str, ...]:
        """Names of the states that have to be tracked before."""
        return (self.previous,) if self.earlier is None else (self.earlier, self.previous)

    def starts(self, tracked: Mapping[str, Motions | None]) -> tuple[Motions | None, ...]:
        """The motions of the state before and, if there are such, those extrapolated; None for no motion."""
        last = tracked[self.previous]
        earlier = None if self.earlier is None else tracked[self.earlier]
        if last is None or not last.usable.any() or (self.earlier is not None and earlier is None):
            return (last,)
        if earlier is not None and not earlier.usable.any():
            return (last,)
        return last, extrapolate(earlier, last, ratio=self.ratio)


def start_of(tables: Sequence[StateTable], index: int) -> StateStart | None:
    """What a state waits for; None if it starts from the reference or from a file."""
    if tables[index].initial != "previous" or index == 0:
        return None
    earlier = None if index == 1 else tables[index - 2]
    first = 0.0 if earlier is None else earlier.time
    last, now = tables[index - 1].time, tables[index].time
    ratio = 1.0
    if first is not None and last is not None and now is not None:
        ratio = (now - last) / (last - first)
    return StateStart(tables[index - 1].name, None if earlier is None else earlier.name, ratio)
