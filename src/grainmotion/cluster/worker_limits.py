"""How many threads and how much memory the workers of a run have, asked before it begins."""

from __future__ import annotations

from dataclasses import dataclass

from grainmotion.cluster.connection import ComputeConfig, client_of, refuse_without_dask


@dataclass(frozen=True)
class WorkerLimits:
    """What a worker may use.

    Attributes
    ----------
    address : str
        Where it is reached; empty for one that a run would start on this machine.
    threads : int
        Threads that its kernels use.
    memory : float
        Bytes of memory; 0 if there is no limit.
    """

    address: str
    threads: int
    memory: float


def limits_of_workers(place: ComputeConfig) -> tuple[WorkerLimits, ...]:
    """The workers that a scheduler has at present, or those that a run would start; none where there are none.

    Raises
    ------
    InputError
        If Dask is missing, or no scheduler answers at the address.
    """
    if not place.is_cluster:
        return ()
    refuse_without_dask(place)
    if place.scheduler is None:
        from distributed.system import MEMORY_LIMIT

        count = place.workers or 1
        memory = MEMORY_LIMIT / count if place.bytes is None else place.bytes  # Dask shares it out so
        return (WorkerLimits("", place.threads_of_each, memory),) * count
    with client_of(place.scheduler) as client:
        workers = client.sync(client.scheduler.identity)["workers"]  # not the record that the client keeps
    found = [WorkerLimits(str(at), int(w["nthreads"]), float(w["memory_limit"] or 0)) for at, w in workers.items()]
    return tuple(sorted(found, key=lambda worker: worker.address))
