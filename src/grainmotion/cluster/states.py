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
from grainmotion.experiment.scans import ScanInput
from grainmotion.experiment.states import track_state
from grainmotion.grains import GrainSet, lay_together
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
    """Names of the states and their motions, whichever is there first."""
    shelved, tasks = shelf.put(grains), dict[str, "Delayed"]()
    for state in states:
        before = [tasks[state.start]] if isinstance(state.start, str) else []
        told = shelf.put((state.source, state.initial, None if before else state.start, settings))
        tasks[state.name] = work.task(_track, *before, grains=shelved, told=told)
    yield from work.as_done(tasks)


def _track(*before: Motions, grains: Shelved, told: Shelved) -> Motions:
    source, initial, start, settings = told.take()
    laid = list(grains.take().grains)
    lay_together(laid)
    with own_threads():
        return track_state(source, initial, GrainSet(tuple(laid)), before[0] if before else start, settings)
