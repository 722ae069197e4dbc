"""Time of a watched state: from its last radiograph to the motions of all grains.

    python -m validation.benchmarks.watch [--kinds rough-20 tall-20] [--grains 100] [--repeats 2] [--keep FOLDER]

Packings are simulated without voxels: a full scan as counts with flats and darks, and one later state of 4 views, each
grain moved by up to 2 voxels and 4° on its own.  A watch (a process of its own) reconstructs and segments the full
scan, which is not counted, and waits; then the radiographs arrive, one after the other.  The time counts from the
moment at which the last one is in its place to that at which ``motions.csv`` is written: two looks at the files,
reading, checks and tracking.  CPU time is user + system of all threads.  The least of the repeats counts.

With ``--keep``, experiments and their references stay in a folder, and another run only tracks: also with changed code,
of which the stored references know nothing.  Writes ``validation/benchmarks/results/watch.md`` where all kinds are
measured with 100 grains, else only prints; ends with code 1 if the bar is missed.
"""

from __future__ import annotations

import argparse
import json
import resource
import shutil
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from grainmotion.analysis.validation import compare
from grainmotion.experiment.config import read_experiment
from grainmotion.io.motions_csv import read_motions
from grainmotion.simulate import LATER_ANGLES_DEG, Particle, Sample, motion_fields, random_polyhedron, stone
from grainmotion.simulate.detector import Physics, record
from grainmotion.simulate.packing import PackingSettings, pack
from grainmotion.simulate.sample import ellipsoid_particle
from grainmotion.simulate.scanner import Scanner
from grainmotion.simulate.scenarios import STONE_COUNT
from grainmotion.workflow.dataset import write_dataset
from grainmotion.workflow.watch import watch
from grainmotion.workflow.watch_session import WatchSettings
from validation.benchmarks.peers.environment import machine

ROOT = Path(__file__).parents[2]
RESULT = Path(__file__).parent / "results" / "watch.md"
N_GRAINS, WALL_BAR = 100, 15.0
"""Grains of a packing, and seconds for a state of so many on two idle cores."""
VOXEL, MARGIN = 0.1, 8
"""mm; voxels between the packing and the border of the field."""
WIDTHS_TO_SOURCE = 5
"""Distance of the source from the axis in widths of the field."""
CENTRAL_LINE_INTEGRAL, PHOTONS = 1.5, 1e5
"""Line integral through the middle of a packing; photons a pixel detects without it."""
SHIFT, TURN_DEG = 2.0, 4.0
"""Largest motion of a grain, voxels and degrees."""
FILLED, SEEN_OF_TALL = 0.5, 0.8
"""Share of the cylinder that grains fill, about; share of the tall packing's height that the field sees."""
VIEWS = 4
STATE = "later"
Shape = Callable[[int, float, np.random.Generator], Particle]


def rough(index: int, diameter: float, rng: np.random.Generator) -> Particle:
    """A gravel stone; beyond as many as there are shapes, another size of the same ones."""
    level = 3 if diameter < 30 * VOXEL else 4
    return Particle(stone(index % STONE_COUNT, diameter * (1 + 0.08 * rng.uniform(-1, 1)), level), 1.0)


def convex(index: int, diameter: float, rng: np.random.Generator) -> Particle:
    """A convex polyhedron of random corners."""
    return Particle(random_polyhedron(rng, diameter * (1 + 0.08 * rng.uniform(-1, 1))), 1.0)


def smooth(index: int, diameter: float, rng: np.random.Generator) -> Particle:
    """An ellipsoid, which half turns about its axes leave as it is."""
    return ellipsoid_particle(rng, diameter, 1.0, elongation=1.4)


@dataclass(frozen=True)
class Kind:
    """One packing: what its grains are, how many voxels across, and whether it is taller than the field of view."""

    summary: str
    shape: Shape
    across: int
    tall: bool = False


KINDS = {
    "rough-20": Kind("gravel stones, 20 voxels across", rough, 20),
    "rough-40": Kind("gravel stones, 40 voxels across", rough, 40),
    "convex-20": Kind("convex polyhedra, 20 voxels across", convex, 20),
    "convex-40": Kind("convex polyhedra, 40 voxels across", convex, 40),
    "ellipsoids-22": Kind("smooth ellipsoids, 22 voxels across", smooth, 22),
    "tall-20": Kind("gravel stones, 20 voxels across, in a packing taller than the field of view", rough, 20, True),
}


def packing(kind: Kind, n: int, seed: int) -> tuple[Sample, tuple[int, int]]:
    """A settled packing about the middle of the field, and rows and columns of the panel that sees it."""
    rng = np.random.default_rng(seed)
    diameter = kind.across * VOXEL
    height_over_radius = 4.0 if kind.tall else 2.2
    radius = max(diameter * (n / (6 * FILLED * height_over_radius)) ** (1 / 3), 1.2 * diameter)
    loose = [kind.shape(int(k), diameter, rng) for k in rng.permutation(n)]
    settled = pack(loose, PackingSettings(radius), seed)
    outlines = np.concatenate([p.shape.outline for p in settled.particles])
    low, high = outlines[:, 2].min(), outlines[:, 2].max()
    if kind.tall:
        high = low + SEEN_OF_TALL * (high - low) - MARGIN * VOXEL
    attenuation = CENTRAL_LINE_INTEGRAL / (FILLED * 2 * radius)
    middle = np.array([0.0, 0.0, (low + high) / 2])
    particles = [Particle(p.shape.moved(np.eye(3), -middle), attenuation) for p in settled.particles]
    wide = 2 * np.linalg.norm(outlines[:, :2], axis=1).max()
    columns = int(wide / VOXEL) + 2 * MARGIN
    distance = WIDTHS_TO_SOURCE * VOXEL * columns
    nearest = 1.0 if kind.tall else distance / (distance - wide / 2)  # what lies nearer to the source looks taller
    rows = int(nearest * (high - low) / VOXEL) + 2 * MARGIN
    return Sample(tuple(particles)), (rows, columns)


def scanner_of(panel: tuple[int, int]) -> Scanner:
    """The scanner whose panel has these rows and columns, a voxel wide each at the axis."""
    distance = WIDTHS_TO_SOURCE * VOXEL * panel[1]
    return Scanner(panel, 4 * VOXEL, distance, 4 * distance, panel[1])


def write_experiment(folder: Path, kind: Kind, n: int, seed: int) -> None:
    """The experiment, its truth, and the radiographs of its state in a folder from which they will arrive."""
    sample, panel = packing(kind, n, seed)
    scanner = scanner_of(panel)
    physics = Physics(photons=PHOTONS, counts_per_photon=40_000 / PHOTONS, dark=100, dark_noise=2, subsamples=2)
    truth = motion_fields.random(sample, SHIFT * VOXEL, TURN_DEG, seed + 1)
    views = scanner.geometry(LATER_ANGLES_DEG[VIEWS])
    states = {STATE: (record(sample.moved(truth), views, physics, seed + 1000), truth)}
    write_dataset(folder, record(sample, scanner.geometry(), physics, seed), states, scanner.grid)
    (folder / STATE).rename(folder / "arriving")
    (folder / STATE).mkdir()
    border = panel[0] / 2 * VOXEL
    tops = [np.abs(p.shape.outline[:, 2]).max() for p in sample.particles]
    bottoms = [np.abs(p.shape.outline[:, 2]).min() for p in sample.particles]
    cut = sum(int(bottom < border < top) for bottom, top in zip(bottoms, tops, strict=True))
    (folder / "case.json").write_text(json.dumps({"panel": panel, "cut": cut}))


class Arrival:
    """The radiographs of the state arrive once the watch is ready; the times at which they are there and tracked."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.there, self.tracked = (0.0, 0.0), (0.0, 0.0)  # wall and CPU time, s
        self.thread = threading.Thread(target=self.arrive)

    def say(self, line: str) -> None:
        """What a watch says when it is ready, and when a state is tracked."""
        print(line, file=sys.stderr)
        if line.startswith("watching"):
            self.thread.start()
        elif line.startswith(f"{STATE}: "):
            self.tracked = now()

    def arrive(self) -> None:
        """Move one radiograph after the other to where the watch looks for them."""
        for path in sorted((self.folder / "arriving").glob("*.tif")):
            time.sleep(0.5)
            partial = self.folder / STATE / f"{path.name}.part"
            shutil.copyfile(path, partial)
            partial.rename(partial.with_suffix(""))
        self.there = now()


def now() -> tuple[float, float]:
    """Wall and CPU time, s."""
    return time.perf_counter(), time.process_time()


def work(folder: Path) -> dict[str, float]:
    """Watch an experiment until its state is tracked: times, errors and memory."""
    shutil.rmtree(folder / "results" / STATE, ignore_errors=True)
    for path in (folder / STATE).iterdir():
        path.unlink()
    arrival = Arrival(folder)
    result = watch(read_experiment(folder / "experiment.toml"), settings=WatchSettings(until=1), say=arrival.say)
    arrival.thread.join()
    wall, cpu = np.subtract(arrival.tracked, arrival.there)
    motions = read_motions(folder / "results" / STATE / "motions.csv")
    truth = read_motions(folder / f"{STATE}-truth.csv")
    seen = np.abs(truth.centers[:, 2]) < json.loads((folder / "case.json").read_text())["panel"][0] / 2 * VOXEL
    errors = compare(motions, truth.for_grains(truth.labels[seen], truth.centers[seen]), VOXEL)
    return {
        "grains": len(result.motions[STATE]),
        "usable": int(motions.usable.sum()),
        "failures": errors.failures + len(errors.spurious),
        "voxels": errors.translation_rms_voxels,
        "degrees": errors.rotation_rms_deg,
        "wall": wall,
        "cpu": cpu,
        "memory": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 / 1e9,
    }


def measure(name: str, n: int, repeats: int, kept: Path) -> dict[str, Any]:
    """Make an experiment if it is not there, and watch it in processes of their own."""
    folder = kept / f"{name}-{n}"
    if not (folder / "case.json").exists():
        shutil.rmtree(folder, ignore_errors=True)
        print(f"{folder.name}: simulating ...", flush=True)
        write_experiment(folder, KINDS[name], n, seed=0)
    found = []
    for _ in range(repeats):
        command = [sys.executable, "-m", "validation.benchmarks.watch", "--work", str(folder)]
        done = subprocess.run(command, capture_output=True, text=True, cwd=ROOT)
        if done.returncode:
            raise SystemExit(f"{folder.name}: the watch failed\n{done.stderr[-3000:]}")
        found.append(json.loads(done.stdout.strip().splitlines()[-1]))
        print(f"{folder.name}: {json.dumps(found[-1])}", flush=True)
    least = {key: min(f[key] for f in found) for key in ("wall", "cpu")}
    return {**found[-1], **least, **json.loads((folder / "case.json").read_text())}


def degrees(found: dict[str, Any]) -> str:
    """Error of rotation; a dash where no rotation is a result to use."""
    return f"{found['degrees']:.2f}" if np.isfinite(found["degrees"]) else "-"


def page(found: dict[str, dict[str, Any]], options: argparse.Namespace) -> str:
    """The table of all kinds."""
    rows = [
        f"| {KINDS[name].summary} | {f['panel'][0]} × {f['panel'][1]} | {f['grains']} | {f['cut']} | {f['usable']} "
        f"| {f['failures']} | {f['voxels']:.3f} | {degrees(f)} | {f['cpu']:.1f} | {f['wall']:.1f} "
        f"| {f['memory']:.2f} |"
        for name, f in found.items()
    ]
    missed = misses(found)
    return "\n".join(
        [
            "# Time of a watched state",
            "",
            f"{options.grains} grains in a settled packing, simulated without voxels, {VIEWS} views, each grain moved",
            f"by up to {SHIFT:g} voxels and {TURN_DEG:g}° on its own.  Seconds from the last radiograph to",
            f"`motions.csv`, the least of {options.repeats}; reference and kernels are ready, files are looked at",
            "every second.",
            "",
            "| packing | panel | grains found | cut by the border | usable | failures | translation, voxels "
            "| rotation, degrees | CPU s | wall s | peak memory, GB |",
            f"|{'---|' * 11}",
            *rows,
            "",
            "Errors are root mean square over grains and components, against the simulation's truth.  A grain that is",
            "missing, without a result to use, beyond 1 voxel or 5°, or spurious counts as a failure; those whose",
            "centres are outside the field of view are left out.  Smooth ellipsoids look alike after half turns, and",
            "rotations that radiographs do not tell count as failures.  The wall time depends on what else the machine",
            "does.",
            "",
            f"The bar, at most {WALL_BAR:g} s on two idle cores: "
            f"{'missed by ' + ', '.join(missed) if missed else 'met'}.",
            "",
            f"{machine()}.  Made by `python -m validation.benchmarks.watch --kinds {' '.join(found)} "
            f"--grains {options.grains} --repeats {options.repeats}`.",
            "",
        ]
    )


def misses(found: dict[str, dict[str, Any]]) -> list[str]:
    """Kinds that take longer than the bar."""
    return [name for name, f in found.items() if f["wall"] > WALL_BAR]


def main() -> int:
    """Measure all kinds, write the table, and say whether the bar is met."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--kinds", nargs="+", choices=KINDS, default=list(KINDS))
    parser.add_argument("--grains", type=int, default=N_GRAINS)
    parser.add_argument("--repeats", type=int, default=2)
    parser.add_argument("--keep", type=Path, help="folder in which experiments and references are kept for another run")
    parser.add_argument("--work", type=Path, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.work is not None:
        print(json.dumps(work(options.work)))
        return 0
    with tempfile.TemporaryDirectory() as name:
        kept = options.keep or Path(name)
        found = {kind: measure(kind, options.grains, options.repeats, kept.absolute()) for kind in options.kinds}
    text = page(found, options)
    if found.keys() == KINDS.keys() and options.grains == N_GRAINS:
        RESULT.write_text(text)
    print(text)
    return 1 if misses(found) else 0


if __name__ == "__main__":
    sys.exit(main())
