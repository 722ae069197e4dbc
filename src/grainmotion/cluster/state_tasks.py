"""Tasks that track whole states, several states at the same time, each on one worker.

Small samples are tracked so: sharing one state's projections out would take longer than doing them.  A state that
starts from another's motions waits for it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
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


def _no_motion(tracked: Mapping[str, Motions | None]) -> tuple[Motions | None, ...]:
    return (None,)


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
    after : tuple of str
        States in the list that have to be tracked before it.
    starts : callable
        From the motions of all states tracked so far, None for one that is not to be tracked, to the motions to start
        from: the first of them is handed to ``scan``, and the one that fits the radiographs best is taken.
    """

    name: str
    scan: Scan | Callable[[Motions | None], Scan | None]
    initial: str
    after: tuple[str, ...] = ()
    starts: Callable[[Mapping[str, Motions | None]], tuple[Motions | None, ...]] = _no_motion


@dataclass(frozen=True, eq=False)
class _Given:
    """What a worker tracks."""

    name: str
    scan: Scan
    initial: str
    starts: tuple[Motions | None, ...]
    settings: TrackSettings


def track_distributed(
    executor: Executor, store: SharedStore, grains: GrainSet, states: Sequence[State], settings: TrackSettings
) -> Iterator[tuple[str, Motions]]:
    """Names of the states and their motions, whichever is there first; no more at once than there are workers.

    A state that is not to be tracked is left out.
    """
    stored, waiting, tracked = store.put(grains), list(states), dict[str, Motions | None]()

    def ready() -> State | None:
        return next((s for s in waiting if tracked.keys() >= set(s.after)), None)

    def more() -> tuple[str, Delayed] | None:
        while (state := ready()) is not None:
            waiting.remove(state)
            starts = state.starts(tracked)
            scan = state.scan if isinstance(state.scan, Scan) else state.scan(starts[0])
            if scan is None:
                tracked[state.name] = None
                continue
            given = store.put(_Given(state.name, scan, state.initial, starts, settings))
            return state.name, executor.task(_track, grains=stored, given=given)
        return None

    for name, motions in executor.as_completed(more):
        tracked[name] = motions
        yield name, motions


def _track(grains: StoredObject, given: StoredObject) -> Motions:
    with use_worker_threads():  # one state at a time, so that the grains are here once
        state = given.load()
        with errors_of_state(f"states.{state.name}", state.initial):
            return track(grains.load(), state.scan, state.starts, state.settings, device=CPU)
