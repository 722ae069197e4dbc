"""Tasks that track whole states, several states at the same time, each on one worker.

Small samples are tracked so: sharing one state's projections out would take longer than doing them.  A state that
starts from another's motions waits for it.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from grainmotion.backends.cpu import CPU
from grainmotion.cluster.executor import Executor
from grainmotion.cluster.shared_store import SharedStore, StoredObject
from grainmotion.cluster.worker_threads import use_worker_threads
from grainmotion.experiment.state_tracking import errors_of_state
from grainmotion.model.grains import GrainSet
from grainmotion.model.motions import Motions
from grainmotion.model.scan import Scan
from grainmotion.tracking.settings import TrackSettings
from grainmotion.tracking.track import track

if TYPE_CHECKING:
    from dask.delayed import Delayed


@dataclass(frozen=True, eq=False)
class State:
    """A state to be tracked.

    Attributes
    ----------
    name : str
    scan : Scan
        Its radiographs, corrected.
    initial : str
        What the experiment file says of its start.
    start : Motions or str, optional
        The motions to start from, or the state before it in the list that will have them; None is no motion.
    """

    name: str
    scan: Scan
    initial: str
    start: Motions | str | None


def track_distributed(
    executor: Executor, store: SharedStore, grains: GrainSet, states: Sequence[State], settings: TrackSettings
) -> Iterator[tuple[str, Motions]]:
    """Names of the states and their motions, whichever is there first; no more at once than there are workers."""
    stored, waiting, tracked = store.put(grains), list(states), dict[str, Motions]()

    def more() -> tuple[str, Delayed] | None:
        for state in waiting:
            start = tracked.get(state.start) if isinstance(state.start, str) else state.start
            if isinstance(state.start, str) and start is None:
                continue
            waiting.remove(state)
            given = store.put((replace(state, start=start), settings))
            return state.name, executor.task(_track, grains=stored, given=given)
        return None

    for name, motions in executor.as_completed(more):
        tracked[name] = motions
        yield name, motions


def _track(grains: StoredObject, given: StoredObject) -> Motions:
    with use_worker_threads():  # one state at a time, so that the grains are here once
        state, settings = given.load()
        with errors_of_state(f"states.{state.name}", state.initial):
            return track(grains.load(), state.scan, state.start, settings, device=CPU)
