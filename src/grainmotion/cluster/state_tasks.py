"""Tasks that track whole states, several states at the same time, each on one worker.

Small samples are tracked so: sharing one state's projections out would take longer than doing them.  A state that
starts from another's motions waits for it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
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
    scan : Scan or callable
        Its radiographs, corrected; or a function that checks the state and reads them, once its start is known.  It is
        called in this process, with the start, and gives None if the state is not to be tracked.
    initial : str
        What the experiment file says of its start.
    start : Motions or str, optional
        The motions to start from, or the state before it in the list that will have them; None is no motion.
    """

    name: str
    scan: Scan | Callable[[Motions | None], Scan | None]
    initial: str
    start: Motions | str | None


def track_distributed(
    executor: Executor, store: SharedStore, grains: GrainSet, states: Sequence[State], settings: TrackSettings
) -> Iterator[tuple[str, Motions]]:
    """Names of the states and their motions, whichever is there first; no more at once than there are workers.

    A state that is not to be tracked is left out; the one after it starts from no motion.
    """
    stored, waiting, tracked = store.put(grains), list(states), dict[str, Motions | None]()

    def ready() -> State | None:
        return next((s for s in waiting if not isinstance(s.start, str) or s.start in tracked), None)

    def more() -> tuple[str, Delayed] | None:
        while (state := ready()) is not None:
            waiting.remove(state)
            start = tracked[state.start] if isinstance(state.start, str) else state.start
            scan = state.scan if isinstance(state.scan, Scan) else state.scan(start)
            if scan is None:
                tracked[state.name] = None
                continue
            given = store.put((replace(state, scan=scan, start=start), settings))
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
