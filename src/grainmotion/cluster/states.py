"""States side by side: each tracked whole by one worker, from grains on the shelf and radiographs that it reads.

So small samples are tracked, whose walks take less than handing them out (`crew.WORTH`).  A state that starts from
another's motions follows it.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from grainmotion.cluster.shelf import Shelf, Shelved
from grainmotion.cluster.threads import own_threads
from grainmotion.cluster.work import Work
from grainmotion.device import CPU
from grainmotion.experiment.scans import ScanInput
from grainmotion.experiment.states import track_state
from grainmotion.grains import GrainSet
from grainmotion.motions import Motions
from grainmotion.track import TrackSettings

if TYPE_CHECKING:
    from dask.delayed import Delayed


@dataclass(frozen=True, eq=False)
class State:
    """A state to be tracked.

    Attributes
    ----------
    name : str
    source : ScanInput
        Its radiographs.
    initial : str
        What the experiment file says of its start.
    start : Motions or str, optional
        The motions to start from, or the state before it in the list that will have them; None is no motion.
    """

    name: str
    source: ScanInput
    initial: str
    start: Motions | str | None


def track_scattered(
    work: Work, shelf: Shelf, grains: GrainSet, states: Sequence[State], settings: TrackSettings
) -> Iterator[tuple[str, Motions]]:
    """Names of the states and their motions, whichever is there first; no more at once than there are workers."""
    shelved, waiting, found = shelf.put(grains), list(states), dict[str, Motions]()

    def more() -> tuple[str, Delayed] | None:
        for state in waiting:
            start = found.get(state.start) if isinstance(state.start, str) else state.start
            if isinstance(state.start, str) and start is None:
                continue
            waiting.remove(state)
            told = shelf.put((state.source, state.initial, start, settings))
            return state.name, work.task(_track, grains=shelved, told=told)
        return None

    for name, motions in work.as_done(more):
        found[name] = motions
        yield name, motions


def _track(grains: Shelved, told: Shelved) -> Motions:
    with own_threads():  # one state at a time, so that the grains are here once
        source, initial, start, settings = told.take()
        return track_state(source, initial, grains.take(), start, settings, device=CPU)
