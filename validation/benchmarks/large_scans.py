"""Memory and CPU time of whole runs against the size of the scan, and what ``--dry-run`` told of them before.

    python -m validation.benchmarks.large_scans [--sizes 160 320 512] [--folder .scale]

N³ voxels, N views of N × N pixels, one later state of 4 views (`packed_cylinder`).  Each run is a process of its own:
its peak is the largest resident memory that the system tells, its CPU time is user + system of all threads, those of
the stages come from ``run.log``.  Data and results stay in the folder; a second call measures again.  1000³ takes
hours and 20 GB of disk.  Writes ``validation/benchmarks/results/large_scans.md``; ends with code 1 if a run takes more
memory than its bar, or the estimates of memory or time are off by more than theirs.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import shutil
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

from validation.benchmarks.packed_cylinder import write_packed_cylinder
from validation.benchmarks.peers.environment import ROOT, machine

RESULT = Path(__file__).parent / "results" / "large_scans.md"
BYTES_PER_VOXEL, BYTES_PER_PIXEL, BYTES_OF_PROGRAM = 12, 6, 500e6
"""The memory's bar: so much a voxel, a pixel of the reference's radiographs, and in any case."""
ESTIMATE_BAR = 0.3
"""Largest relative difference of the estimates of memory and time from what was measured."""
STAGES = ("calibrate", "reconstruct", "segment", "one/track", "report")
_DONE = re.compile(r" done: (\S+), ([\d.]+) s, ([\d.]+) s of CPU")


@dataclass(frozen=True)
class Measured:
    """A run: bytes at its peak, CPU seconds in all and by stage, the grains, and what was estimated before."""

    size: int
    grains: int
    peak: float
    seconds: float
    stages: dict[str, float]
    told_peak: float
    told_seconds: float

    @property
    def bar(self) -> float:
        """Bytes that the run may take."""
        return BYTES_PER_VOXEL * self.size**3 + BYTES_PER_PIXEL * self.size**3 + BYTES_OF_PROGRAM

    @property
    def met(self) -> bool:
        """Whether it keeps to its bars."""
        told = (self.told_peak / self.peak, self.told_seconds / self.seconds)
        return self.peak <= self.bar and all(abs(ratio - 1) <= ESTIMATE_BAR for ratio in told)


def measured(size: int, folder: Path) -> Measured:
    """Make the data if need be, ask for the estimate, and run."""
    grains = write_packed_cylinder(size, folder / str(size))
    experiment, out = folder / str(size) / "experiment.toml", folder / f"results-{size}"
    shutil.rmtree(out, ignore_errors=True)
    command = [sys.executable, "-m", "grainmotion", "run", str(experiment), "--out", str(out)]
    told = subprocess.run([*command, "--dry-run", "--json"], check=True, capture_output=True, text=True, cwd=ROOT)
    estimate = json.loads(told.stdout)["result"]
    process = subprocess.Popen([*command, "--quiet"], cwd=ROOT)
    _, status, usage = os.wait4(process.pid, 0)
    if os.waitstatus_to_exitcode(status) not in (0, 3):
        raise RuntimeError(f"the run of {size}³ voxels ended with {os.waitstatus_to_exitcode(status)}")
    stages = {name: float(cpu) for name, _, cpu in _DONE.findall((out / "run.log").read_text())}
    seconds = usage.ru_utime + usage.ru_stime
    return Measured(size, grains, 1024.0 * usage.ru_maxrss, seconds, stages, estimate["memory"], estimate["seconds"])


def row(run: Measured) -> str:
    """A line of the table."""
    rest = run.seconds - sum(run.stages.get(stage, 0.0) for stage in STAGES)
    times = [f"{run.stages.get(stage, 0.0):,.0f}" for stage in STAGES]
    cells = [
        f"{run.size}³", f"{run.grains:,}", f"{run.peak / 1e9:.2f}", f"{run.bar / 1e9:.2f}",
        f"{run.peak / run.size**3:.0f}", f"{run.told_peak / run.peak:.2f}", f"{run.seconds:,.0f}", f"{rest:,.0f}",
        *times, f"{run.told_seconds / run.seconds:.2f}",
    ]  # fmt: skip
    return f"| {' | '.join(cells)} |"


def table(runs: list[Measured], call: str) -> str:
    """The page of results."""
    passed = all(run.met for run in runs)
    return "\n".join(
        [
            "# Whole runs against the size of the scan",
            "",
            "N³ voxels, N cone-beam views of N × N pixels as 16-bit files, ellipsoids 22 voxels across, one later",
            "state of 4 views, default settings, from the files to the report in one process.  *Peak* is the largest",
            "resident memory, *a voxel* its bytes over the voxels; CPU seconds are of all threads; *told* is the",
            "estimate of `--dry-run` over what was measured.  *Other* is reading, checks and loading of libraries.",
            "",
            "| N³ | grains | peak, GB | bar, GB | a voxel, bytes | told | CPU s | other | "
            + " | ".join(stage.removeprefix("one/") for stage in STAGES) + " | told |",
            "|---|---|---|---|---|---|---|---|" + "---|" * (len(STAGES) + 1),
            *map(row, runs),
            "",
            f"Bars: {BYTES_PER_VOXEL} bytes a voxel, {BYTES_PER_PIXEL} a pixel of the reference's radiographs and "
            f"{BYTES_OF_PROGRAM / 1e6:.0f} MB; estimates within {ESTIMATE_BAR:.0%}: {'met' if passed else 'NOT met'}.",
            "",
            f"{machine()}.  Made by `{call}`.",
            "",
        ]
    )  # fmt: skip


def main() -> int:
    """Measure all sizes, write the table, and say whether the bars are met."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--sizes", type=int, nargs="+", default=[160, 320, 512], help="edges of the volume, voxels")
    parser.add_argument("--folder", type=Path, default=ROOT / ".scale", help="where data and results are kept")
    options = parser.parse_args()
    runs = []
    for size in options.sizes:
        runs.append(measured(size, options.folder))
        print(row(runs[-1]), flush=True)
    text = table(runs, f"python -m validation.benchmarks.large_scans --sizes {' '.join(map(str, options.sizes))}")
    RESULT.write_text(text)
    print(text)
    return 0 if all(run.met for run in runs) else 1


if __name__ == "__main__":
    sys.exit(main())
