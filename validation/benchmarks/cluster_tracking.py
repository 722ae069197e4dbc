"""Tracking by workers: one process, one worker and two, of one thread each; bits compared, bytes measured and modelled.

    python -m validation.benchmarks.cluster_tracking [--grains 200] [--repeat 2]

The sample is that of `crowd`, stones 14 voxels across, all of it projected by the workers whatever its size.  The
answers must be the same bits.  On a machine that others use the clock says little, so CPU seconds along the critical
path (client and scheduler, then the busier worker) are given as well.  Bytes are Dask's own counters: what one worker
sends goes to the client, what two send beyond that to each other; they must agree with `models.cluster` within 20 %.
Writes ``validation/benchmarks/results/cluster_tracking.md``; ends with code 1 if bits differ, bytes are off or two
workers are not 1.7 times one.
"""

from __future__ import annotations

import argparse
import os
import resource
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from unittest import mock

import distributed
import numpy as np

from grainmotion._typing import Float
from grainmotion.cluster import dask_backend, remote_arrays
from grainmotion.cluster.connection import ComputeConfig, connect
from grainmotion.cluster.dask_backend import DaskBackend
from grainmotion.model.motions import Motions
from grainmotion.tracking.track import track
from validation.benchmarks.crowd import ACROSS, Crowd, crowd
from validation.benchmarks.models.cluster import Network, Sample, product, tracking
from validation.benchmarks.peers.environment import machine

RESULT = Path(__file__).parent / "results" / "cluster_tracking.md"
SPEEDUP_BAR, MODEL_TOLERANCE = 1.7, 0.2
PRODUCT_COUNT = 20
"""Products with the normal matrix a step, about as many as 1,000 grains take (`many_grains`)."""


@dataclass
class Took:
    """One tracking: seconds by the clock, CPU seconds of this process and of each worker, bytes sent and modelled."""

    clock: float
    client: float
    workers: tuple[float, ...]
    sent: int
    between: float
    home: float
    rounds: int

    @property
    def path(self) -> float:
        """CPU seconds one after the other."""
        return self.client + max(self.workers, default=0.0)


def used() -> float:
    """CPU seconds of a process so far."""
    usage = resource.getrusage(resource.RUSAGE_SELF)
    return usage.ru_utime + usage.ru_stime


def sent(dask_worker: Any) -> int:
    """Bytes that a worker sent so far."""
    return int(dask_worker.transfer_outgoing_bytes_total)


@contextmanager
def modelled(workers: int) -> Iterator[dict[str, float]]:
    """Bytes between workers and to the client by the model, and rounds, of all that is asked for meanwhile."""
    out = {"between": 0.0, "home": 0.0, "rounds": 0}

    def sample(boxes: Any, views: int, columns: int) -> Sample:
        """Parameters of the model: mean patch and shaded rows."""
        height = float((boxes[:, 3] - boxes[:, 2]).mean())
        shaded = int(boxes[:, 3].max() - boxes[:, 2].min())
        grains = len(np.unique(boxes[:, 0]))
        return Sample(grains, views, shaded, columns, height, 0, 0, 0, 0.0, 0.0, 0.0)

    vjp, map_grains = DaskBackend.vjp, DaskBackend.map_grains
    gram_blocks, add_patches = DaskBackend.gram_blocks, DaskBackend.add_patches
    host, sums = remote_arrays.RemoteArray.host.func, remote_arrays.RemoteSum.host.func

    def counted_vjp(self: Any, derivatives: Any, patches: Any, stacks: Any) -> Float:
        found = vjp(self, derivatives, patches, stacks)
        out["home"] += found.nbytes
        if isinstance(stacks, remote_arrays.RemoteSum):
            columns, views, _, width = stacks.shape
            out["between"] += product(sample(patches.boxes, views, width), workers, columns).between_workers
            out["rounds"] += 1
        return found

    def counted_map(self: Any, *arguments: Any) -> Float:
        found = map_grains(self, *arguments)
        out["home"] += found.nbytes
        return found

    def counted_blocks(self: Any, *arguments: Any) -> Float:
        found = gram_blocks(self, *arguments)
        out["home"] += found.nbytes
        return found

    def counted_sums(self: Any) -> Any:
        columns, views, _, width = self.shape
        out["home"] += sum(8.0 * columns * views * width * (end - first) for first, end in self.rows)
        return sums(self)

    def counted_add(self: Any, values: Any, patches: Any, shape: Any) -> Any:
        one = sample(patches.boxes, shape[0], shape[2])
        out["home"] += 8 * one.views * one.columns * one.stripe(workers) * workers
        return add_patches(self, values, patches, shape)

    def counted_host(self: Any) -> Any:
        out["home"] += float(np.prod(self.shape)) * np.dtype(self.dtype).itemsize
        return host(self)

    counted = {"vjp": counted_vjp, "map_grains": counted_map, "gram_blocks": counted_blocks, "add_patches": counted_add}
    with (
        mock.patch.multiple(DaskBackend, **counted),
        mock.patch.object(remote_arrays.RemoteArray.host, "func", counted_host),
        mock.patch.object(remote_arrays.RemoteSum.host, "func", counted_sums),
    ):
        yield out


def measured(case: Crowd, small: Crowd, workers: int, repeat: int) -> tuple[Took, Motions]:
    """The least of the repetitions, by CPU time along the path; kernels are compiled."""
    if not workers:
        track(small.grains, small.scan)
        runs = []
        for _ in range(repeat):
            clock, cpu = time.perf_counter(), used()
            found = track(case.grains, case.scan)
            runs.append(Took(time.perf_counter() - clock, used() - cpu, (), 0, 0.0, 0.0, 0))
        return min(runs, key=lambda r: r.path), found
    with (
        distributed.LocalCluster(n_workers=workers, threads_per_worker=1, dashboard_address=None) as cluster,
        distributed.Client(cluster) as client,
        tempfile.TemporaryDirectory() as folder,
        connect(ComputeConfig(cluster.scheduler_address), Path(folder)) as reached,
        mock.patch.object(dask_backend, "MIN_VOXELS_TO_SHARE", 0),
    ):
        assert reached is not None
        track(small.grains, small.scan, device=reached.backend)
        track(case.grains, case.scan, device=reached.backend)  # what more than 100 grains need
        runs = []
        for _ in range(repeat):
            before, bytes_before = client.run(used), sum(client.run(sent).values())
            clock, cpu = time.perf_counter(), used()
            with modelled(workers) as model:
                found = track(case.grains, case.scan, device=reached.backend)
            clock, cpu = time.perf_counter() - clock, used() - cpu
            after, moved = client.run(used), sum(client.run(sent).values()) - bytes_before
            own = tuple(after[w] - before[w] for w in before)
            runs.append(Took(clock, cpu, own, moved, model["between"], model["home"], int(model["rounds"])))
        return min(runs, key=lambda r: r.path), found


def same(one: Motions, other: Motions) -> bool:
    """Bit by bit."""
    names = ("translations", "rotations", "covariances", "residuals", "statuses")
    return all(np.array_equal(getattr(one, n), getattr(other, n), equal_nan=n != "statuses") for n in names)


def paper() -> list[str]:
    """The model, to 128 workers: an evaluation, a product, and a step of both."""
    network, sample = Network(), Sample.large()
    rows = [
        "| workers | evaluation: s | product: s | a step: s | times one | GB between workers, evaluation | product "
        "| MB to the client, evaluation |",
        "|---|---|---|---|---|---|---|---|",
    ]
    first = 0.0
    for workers in (1, 2, 4, 8, 16, 32, 64, 128):
        look, multiply = tracking(sample, workers), product(sample, workers)
        seconds = look.seconds(network), multiply.seconds(network)
        step = seconds[0] + PRODUCT_COUNT * seconds[1]
        first = first or step
        rows.append(
            f"| {workers} | {seconds[0]:.2f} | {seconds[1]:.3f} | {step:.1f} | {first / step:.1f} "
            f"| {look.between_workers / 1e9:.2f} | {multiply.between_workers / 1e9:.2f} | {look.to_client / 1e6:.0f} |"
        )
    return [*rows, "", network.sentence]


def main() -> int:
    """Run it all, write the table, and say whether the bars are met."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--grains", type=int, default=200)
    parser.add_argument("--repeat", type=int, default=2)
    options = parser.parse_args()
    case, small, load = crowd(options.grains), crowd(15), os.getloadavg()[0]
    took: dict[int, Took] = {}
    motions: dict[int, Motions] = {}
    for workers in (0, 1, 2):
        took[workers], motions[workers] = measured(case, small, workers, options.repeat)
        print(workers, took[workers], flush=True)
    equal = [same(motions[0], motions[w]) for w in (1, 2)]
    gain, path = took[1].clock / took[2].clock, took[1].path / took[2].path
    between = took[2].sent - took[1].sent
    off = [between / took[2].between - 1, took[1].sent / took[1].home - 1]
    names = {0: "one process", 1: "1 worker", 2: "2 workers"}
    passed = all(equal) and max(map(abs, off)) <= MODEL_TOLERANCE and max(gain, path) >= SPEEDUP_BAR
    lines = [
        "# Tracking by workers",
        "",
        f"{options.grains} stones {ACROSS} voxels across, one state of 4 views on "
        f"{case.scan.geometry.shape[0]}² pixels; workers of one thread; the least of the repetitions.",
        "",
        "| | s by the clock | client and scheduler, CPU s | workers, CPU s | along the path |",
        "|---|---|---|---|---|",
        *(
            f"| {names[w]} | {t.clock:.1f} | {t.client:.1f} | {' + '.join(f'{c:.1f}' for c in t.workers) or '-'} "
            f"| {t.path:.1f} |"
            for w, t in took.items()
        ),
        "",
        f"Two workers against one: {gain:.2f} times by the clock, {path:.2f} along the path (bar {SPEEDUP_BAR}: "
        f"{'met' if max(gain, path) >= SPEEDUP_BAR else 'MISSED'}). Load of the machine's {os.cpu_count()} cores at "
        f"the start: {load:.1f}. The answers of one process, one worker and two are "
        f"{'the same bits' if all(equal) else 'NOT the same'}.",
        "",
        "| bytes | measured, MB | modelled, MB | off |",
        "|---|---|---|---|",
        f"| between two workers ({took[2].rounds} rounds of products) | {between / 1e6:.1f} | "
        f"{took[2].between / 1e6:.1f} | {100 * off[0]:+.0f} % |",
        f"| from one worker to the client | {took[1].sent / 1e6:.1f} | {took[1].home / 1e6:.1f} "
        f"| {100 * off[1]:+.0f} % |",
        "",
        "## On paper: 10,000 grains of 96 voxels, four views of 2,000 × 2,000 pixels",
        "",
        f"A step is one evaluation and {PRODUCT_COUNT} products with the normal matrix.",
        "",
        *paper(),
        "",
        f"{machine()}.  Made by `python -m validation.benchmarks.cluster_tracking`.",
        "",
    ]
    RESULT.write_text("\n".join(lines))
    print(RESULT.read_text())
    return 0 if passed else 1


if __name__ == "__main__":
    sys.exit(main())
