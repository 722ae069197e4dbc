"""A whole run by one, two and four workers of one thread each, stage by stage.

    python -m validation.benchmarks.workers [--size 320] [--counts 0 1 2 4] [--folder .scale]

N³ voxels, N views of N × N pixels, one later state of 4 views (`packed_cylinder`), from the files to the report.  The
client has as many threads as there are workers, as on a machine of so many cores: what it does alone it does by all of
them, while the workers wait.  The scheduler is in its process.  0 workers is one process of one thread.  Of each stage:
seconds by the clock, CPU seconds of the client and of each worker, bytes that workers sent each other and that all
processes read and wrote in files; at the end, the peak memory of each process.  On a machine that others use the clock
says little, so the *critical path* is given as well: of each stage the CPU time of the client, less what its other
threads did at the same time as the busiest of them, and of the busiest worker.  Kernels are loaded by a small run
before.  All runs must give the same volume, labels and motions, bit by bit.
Writes ``validation/benchmarks/results/workers.md`` and ``.json`` (another size: files of its own); ends with code 1 if
results differ or two workers are not 1.7 times one on the critical path.

``--bytes`` counts bytes alone anew, which do not depend on what else the machine does: those of the results are
replaced, and times, memory and fingerprints stay.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import logging
import os
import resource
import shutil
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray

from grainmotion.model import thread_map
from grainmotion.segmentation.blocks import Work
from validation.benchmarks.packed_cylinder import write_packed_cylinder
from validation.benchmarks.peers.environment import ROOT, machine

RESULT_FOLDER = Path(__file__).parent / "results"
SPEEDUP_BAR, WARM_SIZE = 1.7, 96
STAGES = ("reading, checks", "calibration", "reconstruction", "segmentation", "cutting", "tracking", "report")
LOGGED = {"reconstruct": "reconstruction", "segment": "cutting", "one/track": "tracking"}
"""Stages that end with a line of the log."""


@dataclass
class Stage:
    """One stage: seconds by the clock, CPU seconds of the client and of each worker, and bytes.

    ``beside`` are CPU seconds of the client's threads beside the busiest, which is in ``client``; ``peaks`` bytes of
    memory that the client and each worker used at most.
    """

    clock: float = 0.0
    client: float = 0.0
    beside: float = 0.0
    workers: list[float] = field(default_factory=list)
    between: float = 0.0
    read: float = 0.0
    written: float = 0.0
    peaks: list[float] = field(default_factory=list)

    @property
    def critical(self) -> float:
        """CPU seconds of the client and of the busiest worker."""
        return self.client + max(self.workers, default=0.0)


class ClientThreads:
    """CPU seconds that threads of this process spent while another one of them was busier.

    They are those of compiled kernels, of `Work` and of `by_threads`; what threads of libraries do counts as if it were
    done by one.
    """

    def __init__(self) -> None:
        before = set(os.listdir("/proc/self/task"))
        launch_kernel_threads(np.zeros(numba.get_num_threads()))
        self._of_kernels = set(os.listdir("/proc/self/task")) - before  # beside the one that calls them
        self._of_pools, self._gathered = 0.0, Work.gathered
        Work.gathered = self._timed  # type: ignore[method-assign]
        for module in list(sys.modules.values()):
            if module is not thread_map and getattr(module, "by_threads", None) is thread_map.by_threads:
                vars(module)["by_threads"] = self._timed_map

    def beside(self) -> float:
        """Until now."""
        times = (Path("/proc/self/task", task, "schedstat").read_text().split()[0] for task in self._of_kernels)
        return self._of_pools + sum(map(int, times)) / 1e9

    @property
    def _timed(self) -> Callable[..., list]:
        """`Work.gathered`, whose threads are new for each call."""

        def gathered(work: Work, items: Sequence, start: Callable[[], object], add: Callable) -> list:
            with self._counting() as timed:
                return self._gathered(work, items, start, timed(add))

        return gathered

    def _timed_map(self, function: Callable, items: Iterable, most: int | None = None) -> list:
        """`by_threads`, likewise."""
        with self._counting() as timed:
            return thread_map.by_threads(timed(function), items, most)

    @contextmanager
    def _counting(self) -> Iterator[Callable[[Callable], Callable]]:
        """Gives what makes of a function one whose threads are timed."""
        spent = dict[int, float]()

        def timed(function: Callable) -> Callable:
            def call(*arguments: object) -> object:
                result = function(*arguments)
                if threading.current_thread() is not threading.main_thread():
                    spent[threading.get_ident()] = time.thread_time()
                return result

            return call

        yield timed
        self._of_pools += sum(spent.values()) - max(spent.values(), default=0.0)


@numba.njit(parallel=True)
def launch_kernel_threads(numbers: NDArray[np.float64]) -> None:
    """Start the threads of kernels."""
    for k in numba.prange(len(numbers)):
        numbers[k] += 1


def used(dask_worker: Any = None) -> dict[str, float]:
    """CPU seconds and bytes of a process so far, and its peak memory since it was last asked."""
    from grainmotion.cluster.team import sent_by_teams

    usage = resource.getrusage(resource.RUSAGE_SELF)
    files = dict(line.split(": ") for line in Path("/proc/self/io").read_text().splitlines())
    status = dict(line.split(":", 1) for line in Path("/proc/self/status").read_text().splitlines())
    Path("/proc/self/clear_refs").write_text("5")  # the peak begins anew
    sent = sent_by_teams() + (0 if dask_worker is None else dask_worker.transfer_outgoing_bytes_total)
    return {
        "cpu": usage.ru_utime + usage.ru_stime, "sent": float(sent), "read": float(files["rchar"]),
        "written": float(files["wchar"]), "peak": 1024.0 * float(status["VmHWM"].split()[0]),
    }  # fmt: skip


class Counters(logging.Handler):
    """What each stage took: `mark` puts what was used since the last mark to a stage's account."""

    def __init__(self, client: Any) -> None:
        super().__init__()
        self.client, self.stages = client, {name: Stage() for name in STAGES}
        self.threads = ClientThreads()
        self.before = self.now()

    def now(self) -> tuple[float, dict[str, float], list[dict[str, float]]]:
        """The clock, the client's counters and each worker's."""
        workers = [] if self.client is None else [v for _, v in sorted(self.client.run(used).items())]
        return time.perf_counter(), {**used(), "beside": self.threads.beside()}, workers

    def mark(self, name: str) -> None:
        """Everything since the last mark belongs to a stage."""
        (clock, own, workers), (clock0, own0, workers0) = self.now(), self.before
        self.before = clock, own, workers
        stage = self.stages[name]
        stage.clock += clock - clock0
        beside = own["beside"] - own0["beside"]
        stage.client, stage.beside = stage.client + own["cpu"] - own0["cpu"] - beside, stage.beside + beside
        each = [new["cpu"] - old["cpu"] for new, old in zip(workers, workers0, strict=True)]
        stage.workers = [a + b for a, b in zip(stage.workers or [0.0] * len(each), each, strict=True)]
        stage.between += sum(new["sent"] - old["sent"] for new, old in zip(workers, workers0, strict=True))
        now = [own["peak"], *(new["peak"] for new in workers)]
        stage.peaks = [max(pair) for pair in zip(stage.peaks or [0.0] * len(now), now, strict=True)]
        for key in ("read", "written"):
            moved = own[key] - own0[key] + sum(n[key] - o[key] for n, o in zip(workers, workers0, strict=True))
            setattr(stage, key, getattr(stage, key) + moved)

    def emit(self, record: logging.LogRecord) -> None:
        """A line of the log: a stage may have ended."""
        message = record.getMessage()
        if message.startswith("done: ") and (name := message[6:].split(",")[0]) in LOGGED:
            self.mark(LOGGED[name])


@contextmanager
def marked(module: Any, name: str, before: str, stage: str, counters: Counters) -> Iterator[None]:
    """Mark when a function of a module begins, as the end of one stage, and when it ends."""
    function = getattr(module, name)

    def call(*args: Any, **kwargs: Any) -> Any:
        counters.mark(before)
        try:
            return function(*args, **kwargs)
        finally:
            counters.mark(stage)

    setattr(module, name, call)
    try:
        yield
    finally:
        setattr(module, name, function)


def measure(size: int, count: int, folder: Path, out: Path) -> dict[str, Any]:
    """One run by so many workers, in this process as the client."""
    import dask
    import distributed

    from grainmotion.cluster.connection import LOCAL, ComputeConfig
    from grainmotion.cluster.worker_setup import prepare_workers
    from grainmotion.experiment.config import read_experiment
    from grainmotion.workflow import calibration_stage, reference_stages
    from grainmotion.workflow.log import STAGE_LOG
    from grainmotion.workflow.run import run
    from validation.common.warm import compile_kernels

    with ExitStack() as stack:
        client, place = None, LOCAL
        if count:
            stack.enter_context(dask.config.set({"distributed.worker.profile.enabled": False}))  # as `--workers` does
            cluster = distributed.LocalCluster(n_workers=count, threads_per_worker=1, dashboard_address=None)
            stack.enter_context(cluster)
            client = stack.enter_context(distributed.Client(cluster))
            prepare_workers(client, ours=True)
            place = ComputeConfig(cluster.scheduler_address)
        if client is not None:
            client.run(compile_kernels)  # a state of few grains is the client's
        small = folder / str(WARM_SIZE) / "experiment.toml"
        run(read_experiment(small), out=out.with_name(out.name + "-warm"), workplace=place)
        counters = Counters(client)
        stack.enter_context(marked(calibration_stage, "calibrate_scanner", "reading, checks", "calibration", counters))
        stack.enter_context(marked(reference_stages, "extract_grains", "segmentation", "cutting", counters))
        STAGE_LOG.addHandler(counters)
        run(read_experiment(folder / str(size) / "experiment.toml"), out=out, workplace=place)
        counters.mark("report")
        STAGE_LOG.removeHandler(counters)
    stages = {name: asdict(stage) for name, stage in counters.stages.items()}
    peaks = [max(each) for each in zip(*(stage.peaks for stage in counters.stages.values()), strict=True)]
    return {"stages": stages, "peaks": peaks, "prints": prints(out)}


def prints(out: Path) -> dict[str, str]:
    """Fingerprints of volume, labels and motions."""
    from grainmotion.io.results import read_motions_h5, read_reference

    reference, motions = read_reference(out / "reference.h5"), read_motions_h5(out / "one" / "motions.h5")
    assert reference.labels is not None
    arrays = {
        "volume": [reference.volume.array], "labels": [reference.labels],
        "motions": [motions.translations, motions.rotations, motions.covariances],
    }  # fmt: skip
    return {
        name: hashlib.sha256(b"".join(np.ascontiguousarray(a).tobytes() for a in each)).hexdigest()
        for name, each in arrays.items()
    }


def measured(size: int, count: int, folder: Path) -> dict[str, Any]:
    """`measure` in a process of its own, with as many threads as there are workers."""
    out = folder / f"workers-{size}-{count}"
    for name in (out, out.with_name(out.name + "-warm")):
        shutil.rmtree(name, ignore_errors=True)
    environment = {**os.environ, "NUMBA_NUM_THREADS": str(max(count, 1)), "OMP_NUM_THREADS": "1"}
    command = [sys.executable, "-m", "validation.benchmarks.workers", "--size", str(size), "--folder", str(folder)]
    subprocess.run([*command, "--only", str(count)], check=True, env=environment)
    found: dict[str, Any] = json.loads((folder / f"workers-{size}-{count}.json").read_text())
    shutil.rmtree(out, ignore_errors=True)
    shutil.rmtree(out.with_name(out.name + "-warm"), ignore_errors=True)
    return found


def with_bytes_of(runs: dict[int, dict[str, Any]], size: int) -> dict[int, dict[str, Any]]:
    """The runs of the results, with the bytes of new runs."""
    kept = {int(count): run for count, run in json.loads(results_of(size).read_text())["runs"].items()}
    for count, run in runs.items():
        for name, stage in run["stages"].items():
            kept[count]["stages"][name].update({key: stage[key] for key in ("between", "read", "written")})
    return kept


def results_of(size: int) -> Path:
    """The file of counts."""
    return RESULT_FOLDER / ("workers.json" if size == 320 else f"workers_{size}.json")


def table(size: int, grains: int, found: dict[int, dict[str, Any]], call: str) -> tuple[str, bool]:
    """The page of results, and whether the bar is met."""
    stages = {count: {k: Stage(**v) for k, v in each["stages"].items()} for count, each in found.items()}
    counts = sorted(found)
    first = found[counts[0]]["prints"]
    same = all(each["prints"] == first for each in found.values())

    def total(count: int, value: Callable[[Stage], float]) -> float:
        return sum(map(value, stages[count].values()))

    def row(name: str, value: Callable[[int], str]) -> str:
        return f"| {name} | " + " | ".join(value(count) for count in counts) + " |"

    def cell(stage: Stage) -> str:
        return f"{stage.client:.1f} + {max(stage.workers):.1f}" if stage.workers else f"{stage.client:.1f}"

    def moved(name: str, count: int) -> str:
        stage = stages[count][name]
        return f"{stage.between / 1e6:.0f}, {stage.read / 1e6:.0f}, {stage.written / 1e6:.0f}"

    def critical(stage: Stage) -> float:
        return stage.critical

    lines = [
        f"# A whole run of {size}³ voxels by workers of one thread",
        "",
        f"{size} views of {size} × {size} pixels, {grains} grains, one later state of 4 views, from the files to the",
        "report.  The client has as many threads as there are workers.  CPU seconds of the client with the scheduler,",
        "of its threads that work at the same time those of the busiest, + those of the busiest worker; loading of",
        "kernels is not counted.",
        "",
        "| | " + " | ".join(f"{c} workers" if c else "one process" for c in counts) + " |",
        "|---" * (len(counts) + 1) + "|",
        *(row(name, lambda c, n=name: cell(stages[c][n])) for name in STAGES),
        row("critical path", lambda c: f"{total(c, critical):.0f}"),
        row("all processes", lambda c: f"{total(c, lambda s: s.client + s.beside + sum(s.workers)):.0f}"),
        row("by the clock, s", lambda c: f"{total(c, lambda s: s.clock):.0f}"),
        row("peak of the client, each worker, GB", lambda c: ", ".join(f"{p / 1e9:.2f}" for p in found[c]["peaks"])),
        "",
        "MB sent between workers, read from and written to files (page cache included) by all processes:",
        "",
        "| | " + " | ".join(f"{c} workers" if c else "one process" for c in counts) + " |",
        "|---" * (len(counts) + 1) + "|",
        *(row(name, lambda c, n=name: moved(n, c)) for name in STAGES),
        "",
    ]
    gain = total(1, critical) / total(2, critical) if {1, 2} <= set(counts) else float("nan")
    if {1, 2} <= set(counts):
        clock = total(1, lambda s: s.clock) / total(2, lambda s: s.clock)
        each = ", ".join(
            f"{name} {stages[1][name].critical / max(stages[2][name].critical, 1e-9):.2f}" for name in STAGES
        )
        lines += [
            f"Two workers against one: {gain:.2f} times on the critical path (bar {SPEEDUP_BAR}: "
            f"{'met' if gain >= SPEEDUP_BAR else 'MISSED'}), {clock:.2f} by the clock.  Stage by stage: {each}.",
            "",
        ]
    lines += [
        f"Volume, labels and motions are {'the same bits' if same else 'NOT the same'} in all runs.",
        "",
        f"{machine()}.  Made by `{call}`.",
        "",
    ]
    return "\n".join(lines), same and gain >= SPEEDUP_BAR


def main() -> int:
    """Measure, write the table, and say whether the bar is met."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--size", type=int, default=320, help="edge of the volume, voxels")
    parser.add_argument("--counts", type=int, nargs="+", default=[0, 1, 2, 4], help="numbers of workers")
    parser.add_argument("--folder", type=Path, default=ROOT / ".scale", help="where data and results are kept")
    parser.add_argument("--kept", action="store_true", help="take runs that were measured before from their files")
    parser.add_argument("--bytes", action="store_true", help="count bytes alone anew, and keep all else")
    parser.add_argument("--only", type=int, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.only is not None:
        out = options.folder / f"workers-{options.size}-{options.only}"
        found = measure(options.size, options.only, options.folder, out)
        out.with_name(out.name + ".json").write_text(json.dumps(found))
        return 0
    write_packed_cylinder(WARM_SIZE, options.folder / str(WARM_SIZE))
    grains = write_packed_cylinder(options.size, options.folder / str(options.size))
    runs = {}
    for count in options.counts:
        kept = options.folder / f"workers-{options.size}-{count}.json"
        if options.kept and kept.exists():
            runs[count] = json.loads(kept.read_text())
        else:
            runs[count] = measured(options.size, count, options.folder)
        print(count, {k: round(Stage(**v).critical, 1) for k, v in runs[count]["stages"].items()}, flush=True)
    if options.bytes:
        runs = with_bytes_of(runs, options.size)
    call = f"python -m validation.benchmarks.workers --size {options.size} --counts {' '.join(map(str, sorted(runs)))}"
    text, passed = table(options.size, grains, runs, call)
    path = results_of(options.size)
    path.with_suffix(".md").write_text(text)
    counted = {"size": options.size, "grains": grains, "runs": runs}
    path.write_text(json.dumps(counted, indent=1) + "\n")  # for `cluster_plan`
    print(text)
    return 0 if passed else 1


if __name__ == "__main__":
    sys.exit(main())
