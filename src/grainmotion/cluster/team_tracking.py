"""One state tracked by all workers together: each runs `track` on all grains, and projects its share of them."""

from __future__ import annotations

import secrets
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from grainmotion._typing import Image, Progress
from grainmotion.cluster.executor import Executor
from grainmotion.cluster.shared_store import SharedStore, StoredObject
from grainmotion.cluster.team import Place, Team, listen
from grainmotion.cluster.team_backend import MIN_GRAINS_SHARED, TeamBackend
from grainmotion.cluster.worker_threads import use_worker_threads
from grainmotion.errors import InputError
from grainmotion.experiment.state_tracking import errors_of_state
from grainmotion.model.grains import GrainSet
from grainmotion.model.motions import Motions
from grainmotion.model.scan import Scan
from grainmotion.model.task_map import shared_among
from grainmotion.tracking.settings import TrackSettings
from grainmotion.tracking.track import track_with_residual

if TYPE_CHECKING:
    from distributed import Client, Future

ATTEMPTS = 3
"""Times that a state is begun; again where a worker is lost on the way."""
SECONDS_BETWEEN_LOOKS = 5
"""How often it is looked whether all members are still there."""
SECONDS_BETWEEN_REPORTS = 1.0
"""How often the first member tells its progress."""
TOPIC = "grainmotion-state"
"""Under which the first member tells its progress."""
Tracked = tuple[Motions, Image | None]


@dataclass(frozen=True, eq=False)
class TeamState:
    """A state to track: its name, radiographs, motions to start from and what the experiment file says of these.

    From ``least`` grains on members share the projection; ``tells`` is whether somebody listens to its progress.
    """

    name: str
    scan: Scan
    initial: str
    starts: tuple[Motions | None, ...]
    settings: TrackSettings
    least: int = MIN_GRAINS_SHARED
    tells: bool = False


def track_together(
    executor: Executor, store: SharedStore, grains: GrainSet, state: TeamState, progress: Progress | None = None
) -> Tracked:
    """The motions of a state and its residual radiographs, as `track_with_residual`, by all workers.

    Raises
    ------
    InputError
        If workers are lost time and again.
    """
    stored, own = store.put(grains), SharedStore(store.folder)
    client = executor.client
    if progress is not None:
        client.subscribe_topic(TOPIC, lambda event: progress(*event[1]))
    try:
        given = own.put(replace(state, tells=progress is not None))
        for _ in range(ATTEMPTS):
            found = _attempted(executor, stored, given)
            if found is not None:
                return found
    finally:
        if progress is not None:
            client.unsubscribe_topic(TOPIC)
        own.close()
    fact = f"workers were lost {ATTEMPTS} times while they tracked a state"
    raise InputError("cluster", fact, "give each worker more memory, or look into their logs")


def _attempted(executor: Executor, grains: StoredObject, given: StoredObject) -> Tracked | None:
    """What the workers of now find; None if one is lost."""
    client = executor.client
    addresses = sorted(set(executor.addresses(executor.worker_count)))
    token = secrets.token_hex(16)
    places = client.gather(_one_each(client, addresses, _place, [(token,)] * len(addresses)))
    arguments = [(rank, tuple(places), token, grains, given) for rank in range(len(addresses))]
    members = _one_each(client, addresses, _track, arguments)
    error = _first_error(executor, members, addresses)
    if error is None:
        found: Tracked = members[0].result()
        return found
    client.cancel(members, force=True)
    if isinstance(error, OSError) or not _all_there(executor, addresses):
        return None
    raise error


def _one_each(
    client: Client, addresses: Sequence[str], function: Callable[..., object], arguments: Sequence[tuple]
) -> list[Future]:
    """A call of each worker."""
    return [
        client.submit(function, *each, workers=[address], allow_other_workers=False, pure=False)
        for address, each in zip(addresses, arguments, strict=True)
    ]


def _first_error(executor: Executor, members: Sequence[Future], addresses: Sequence[str]) -> BaseException | None:
    """Why a member failed, if one did: rather its own error than that another one has left."""
    from distributed import wait

    while True:
        errors = [member.exception() for member in members if member.status == "error"]
        own = [error for error in errors if not isinstance(error, OSError)]
        pending = [member for member in members if member.status == "pending"]
        if own or not pending:
            return next(iter([*own, *errors]), None)
        try:
            wait(pending, timeout=SECONDS_BETWEEN_LOOKS, return_when="FIRST_COMPLETED")
        except TimeoutError:
            if errors or not _all_there(executor, addresses):
                return next(iter(errors), ConnectionError("a worker was lost"))


def _all_there(executor: Executor, addresses: Sequence[str]) -> bool:
    return set(addresses) <= set(executor.workers())


def _place(token: str) -> Place:
    """Where this worker listens for the others."""
    from distributed import get_worker
    from distributed.comm import get_address_host

    return listen(get_address_host(get_worker().address), token)


def _track(rank: int, places: Sequence[Place], token: str, grains: StoredObject, given: StoredObject) -> Tracked | None:
    """What one member does; the first one has the result."""
    with use_worker_threads():
        state, team = given.load(), Team.meet(rank, places, token)
        try:
            backend, progress = TeamBackend(team, state.least), _teller() if rank == 0 and state.tells else None
            with shared_among(team.call_each, have_all=True), errors_of_state(f"states.{state.name}", state.initial):
                found = track_with_residual(
                    grains.load(), state.scan, state.starts, state.settings, progress=progress, device=backend
                )
        finally:
            team.close()
    return found if rank == 0 else None


def _teller() -> Progress:
    """Progress told to the client, not too often: each report costs the scheduler milliseconds."""
    from distributed import get_worker

    worker, told = get_worker(), [-SECONDS_BETWEEN_REPORTS]

    def tell(message: str, done: int, total: int) -> None:
        if time.monotonic() - told[0] >= SECONDS_BETWEEN_REPORTS:
            told[0] = time.monotonic()
            worker.log_event(TOPIC, (message, done, total))

    return tell
