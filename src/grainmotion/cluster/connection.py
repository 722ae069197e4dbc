"""Where to compute: in this process, in processes on this machine, or on the workers of a Dask scheduler."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from functools import partial
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from grainmotion._typing import Image, Progress
from grainmotion.cluster.dask_backend import DaskBackend, worth_sharing
from grainmotion.cluster.distributed_iterate import reconstruct_distributed
from grainmotion.cluster.executor import Executor
from grainmotion.cluster.segmentation_tasks import extract_distributed
from grainmotion.cluster.shared_calls import call_each
from grainmotion.cluster.shared_store import SharedStore, StoredObject
from grainmotion.cluster.state_tasks import State, track_distributed
from grainmotion.cluster.team_backend import MIN_GRAINS_SHARED
from grainmotion.cluster.team_tracking import TeamState, track_together
from grainmotion.cluster.worker_setup import prepare_workers
from grainmotion.errors import InputError
from grainmotion.experiment.scan_inputs import ScanInput
from grainmotion.model.grains import Grain, GrainSet
from grainmotion.model.motions import Motions
from grainmotion.model.task_map import shared_among
from grainmotion.model.volume import Volume
from grainmotion.reconstruction.reconstruct import Reconstruction, ReconstructSettings
from grainmotion.segmentation.grain_cutting import Boxed, CutSettings
from grainmotion.tracking.track import TrackSettings

if TYPE_CHECKING:
    from distributed import Client

SECONDS_TO_ANSWER, SECONDS_TO_FIRST_WORKER = 30, 60
"""How long to wait for a scheduler, and then for its first worker, which starts slowly on a busy machine."""
SIZE = re.compile(r"(?P<number>\d+(\.\d+)?) *(?P<unit>[kMGT]?i?B?)", re.IGNORECASE)
BYTES_OF_UNIT = {
    f"{letter}{binary}{b}": (1024 if binary else 1000) ** power
    for power, letter in enumerate(("", "K", "M", "G", "T"))
    for binary in ("", "I")
    for b in ("", "B")
}


@dataclass(frozen=True, eq=False)
class ClusterConnection:
    """Connected workers, and a folder that all of them see."""

    executor: Executor
    store: SharedStore

    @property
    def backend(self) -> DaskBackend:
        """The workers as the backend that projects grains."""
        return DaskBackend(self.executor, self.store)

    def one_worker_tracks_a_state(self, grains: GrainSet) -> bool:
        """Whether grains are so few that one worker tracks a state sooner than several could together."""
        return not worth_sharing(int(sum(np.prod(grain.volume.shape) for grain in grains.grains)))

    def track(
        self, grains: GrainSet, states: Sequence[State], settings: TrackSettings
    ) -> Iterator[tuple[str, Motions]]:
        """Track states side by side; names and motions, in the order in which they are ready."""
        return track_distributed(self.executor, self.store, grains, states, settings)

    def together(self, grains: GrainSet) -> bool:
        """Whether all workers track a state together, each with all grains (see `cluster.team`)."""
        return self.one_worker_tracks_a_state(grains) and len(grains) >= MIN_GRAINS_SHARED

    def track_together(
        self, grains: GrainSet, state: TeamState, progress: Progress | None = None
    ) -> tuple[Motions, Image | None]:
        """Track one state by all workers; motions and residual radiographs."""
        return track_together(self.executor, self.store, grains, state, progress)

    def cut(
        self, volume: Volume, labels: NDArray[np.integer], boxes: list[Boxed], settings: CutSettings
    ) -> Iterator[Grain | None]:
        """Cut grains; see `grainmotion.segmentation.grain_cutting.cut_grains`."""
        return extract_distributed(self.executor, self.store, volume, labels, boxes, settings)

    def reconstruct(
        self, source: ScanInput, grid: Volume, settings: ReconstructSettings, progress: Progress | None = None
    ) -> Reconstruction:
        """Reconstruct on a grid of zeros a scan that the workers read themselves."""
        return reconstruct_distributed(self.executor, self.store, source, grid, settings, progress)


@dataclass(frozen=True)
class ComputeConfig:
    """Where to compute; this process alone if neither is given.

    Attributes
    ----------
    scheduler : str, optional
        Address of a Dask scheduler, as ``tcp://host:8786``, or its scheduler file (``.json``).
    workers : int, optional
        Processes to start on this machine; they share its cores and memory.
    memory : str, optional
        What this process, or each of the workers that it starts, may use, as ``"8GB"``; by default what is free.
    """

    scheduler: str | None = None
    workers: int | None = None
    memory: str | None = None

    def __post_init__(self) -> None:
        if self.scheduler is not None and self.workers is not None:
            raise InputError("--scheduler and --workers", "both are given", "give one of them")
        if self.workers is not None and self.workers < 1:
            raise InputError("--workers", f"must be at least 1, got {self.workers}", "give a number of processes")
        if self.scheduler is not None and self.memory is not None:
            fact = "workers of a scheduler have the limit that they were started with"
            raise InputError("--memory", fact, "leave it out, and give the limit to `dask worker --memory-limit`")
        if self.memory is not None and self.bytes is None:
            raise InputError("--memory", f"{self.memory!r} is no size", "give a number and a unit, as 8GB")

    @property
    def is_cluster(self) -> bool:
        """Whether other processes compute."""
        return self.scheduler is not None or self.workers is not None

    @property
    def threads_of_each(self) -> int:
        """Threads of each of the processes that are started on this machine."""
        return max(1, (os.cpu_count() or 1) // (self.workers or 1))

    @property
    def bytes(self) -> float | None:
        """``memory`` as a number; None if it is not told."""
        size = None if self.memory is None else SIZE.fullmatch(self.memory.strip())
        return None if size is None else float(size["number"]) * BYTES_OF_UNIT[(size["unit"] or "").upper()]


LOCAL = ComputeConfig()
"""This process alone."""


@contextmanager
def connect(place: ComputeConfig, folder: Path) -> Iterator[ClusterConnection | None]:
    """Connect to the workers of a configuration until the end of a block; None if this process computes alone.

    ``folder`` must be on storage that all of them see: large arrays are exchanged in it.

    Raises
    ------
    InputError
        If Dask is missing, no scheduler answers at the address, no worker comes, or workers do not see the folder.
    """
    if not place.is_cluster:
        yield None
        return
    refuse_without_dask(place)
    import dask

    with ExitStack() as stack:
        # ten thousand grains' poses and outlines travel with their tasks, which Dask would warn of
        stack.enter_context(dask.config.set({"distributed.admin.large-graph-warning-threshold": "1GB"}))
        stack.enter_context(dask.config.set({"distributed.worker.profile.enabled": False}))  # nobody looks at it
        if place.scheduler is not None:
            client, where = stack.enter_context(client_of(place.scheduler)), f"--scheduler {place.scheduler}"
        else:
            client, where = stack.enter_context(_local(place)), "--workers"
        _wait(client, where)
        store = SharedStore(folder)
        stack.callback(store.close)
        _check(client, store, where)
        prepare_workers(client, ours=place.scheduler is None)
        executor = Executor(client)
        stack.enter_context(shared_among(partial(call_each, executor, store)))
        yield ClusterConnection(executor, store)


def refuse_without_dask(place: ComputeConfig) -> None:
    """Raise `InputError` where Dask is missing."""
    if find_spec("distributed") is None:
        where = "--workers" if place.scheduler is None else "--scheduler"
        raise InputError(where, "Dask is not installed", "pip install 'grainmotion[cluster]'")


@contextmanager
def _local(place: ComputeConfig) -> Iterator[Client]:
    import distributed

    with (
        distributed.LocalCluster(
            n_workers=place.workers,
            threads_per_worker=place.threads_of_each,
            memory_limit="auto" if place.bytes is None else int(place.bytes),
            dashboard_address=None,
            silence_logs="CRITICAL",
        ) as cluster,
        distributed.Client(cluster) as client,
    ):
        yield client


def client_of(address: str) -> Client:
    """A client of the scheduler at an address; raises `InputError` where none answers."""
    import distributed
    from distributed.comm import resolve_address

    try:
        if address.endswith(".json"):
            if not Path(address).is_file():  # else the client would wait for it
                raise OSError("no such scheduler file")
            return distributed.Client(scheduler_file=address, timeout=SECONDS_TO_ANSWER)
        resolve_address(address)  # a client that refuses it stays half open, and can block Dask when it is collected
        return distributed.Client(address, timeout=SECONDS_TO_ANSWER)
    except (OSError, ValueError, TimeoutError) as error:
        fact = f"no Dask scheduler answers there ({' '.join(str(error).split())[:120]})"
        raise InputError(
            f"--scheduler {address}", fact, "check the address, or start one with `dask scheduler`"
        ) from None


def _wait(client: Client, where: str) -> None:
    try:
        client.wait_for_workers(1, timeout=SECONDS_TO_FIRST_WORKER)
    except TimeoutError:
        raise InputError(where, "the scheduler has no workers", "start some with `dask worker`") from None


def _check(client: Client, store: SharedStore, where: str) -> None:
    """Refuse workers that have another version of the package, or do not see the store."""
    here = version("grainmotion")
    for worker, (there, sees) in client.run(_report, store.put("seen")).items():
        if there != here:
            fact = f"worker {worker} has grainmotion {there}, this process {here}"
            raise InputError(where, fact, "install the same version on all of them")
        if not sees:
            fact = f"worker {worker} does not see {store.folder.parent}"
            raise InputError(where, fact, "put the results on storage that all workers share (--out)")


def _report(stored: StoredObject) -> tuple[str, bool]:
    return version("grainmotion"), stored.folder.is_dir()
