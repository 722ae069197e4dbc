"""States side by side: each tracked whole by one worker, from grains on the shelf and radiographs that it reads.

So small samples are tracked, whose walks take less than handing them out (`dask_backend.WORTH`).  A state that starts
from another's motions follows it.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from grainmotion.backends.device import CPU
from grainmotion.cluster.executor import Executor
from grainmotion.cluster.shared_store import SharedStore, StoredObject
from grainmotion.cluster.worker_threads import own_threads
from grainmotion.experiment.scan_inputs import ScanInput
from grainmotion.experiment.state_tracking import track_state
from grainmotion.model.grains import GrainSet
from grainmotion.model.motions import Motions
from grainmotion.tracking.track import TrackSettings

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
    work: Executor, shelf: SharedStore, grains: GrainSet, states: Sequence[State], settings: TrackSettings
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


def _track(grains: StoredObject, told: StoredObject) -> Motions:
    with own_threads():  # one state at a time, so that the grains are here once
        source, initial, start, settings = told.take()
        return track_state(source, initial, grains.take(), start, settings, device=CPU)
