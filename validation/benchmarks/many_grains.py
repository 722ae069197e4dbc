"""Cost of tracking against the number of grains: CPU time, memory, errors and counts of one state of 4 views.

    python -m validation.benchmarks.many_grains [--sizes 15 200 1000 10000] [--views 4]

Samples, references and truth are those of `crowd`: stones 14 voxels across whatever their number, on a panel that
grows with the sample.  Each size is tracked in a process of its own with one thread, whose peak memory is taken.  CPU
time is user + system, after compilation, and holds the search for near-symmetries of the grains, which a series of
states needs once.  With fewer views it only prints what it found, the stones among it that say
converged and are in a wrong place (``wrong``; decision 0015).  Writes
``validation/benchmarks/results/many_grains.md`` and ``docs/images/many_grains.png``; ends with code 1 if a bar is
missed.  10,000 stones take some minutes of CPU time; ``--busy`` notes that other jobs ran beside.
"""

from __future__ import annotations

import argparse
import json
import os
import pickle
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from unittest import mock

import matplotlib.pyplot as plt
import numpy as np
from numpy.typing import NDArray

from grainmotion.kernels import grain_projection as walks
from grainmotion.kernels import normal_equations
from grainmotion.model.compact_volume import CompactVolume
from grainmotion.model.grains import Grain, GrainSet
from grainmotion.model.motions import Motions
from grainmotion.model.scan import Scan
from grainmotion.model.volume import Volume
from grainmotion.projection.grain_arrays import GrainArrays
from grainmotion.rotations import recenter, rotation_vector
from grainmotion.segmentation.extraction import MAX_CUT_BYTES
from grainmotion.tracking import attempt
from grainmotion.tracking.self_likeness import known_symmetries
from grainmotion.tracking.track import track
from validation.benchmarks.crowd import ACROSS, VOXEL, crowd
from validation.benchmarks.peers.environment import machine
from validation.common.measures import rms

ROOT = Path(__file__).parents[2]
RESULT, PLOT = (
    ROOT / "validation" / "benchmarks" / "results" / "many_grains.md",
    ROOT / "docs" / "images" / "many_grains.png",
)
GRAIN_NUMBERS = (15, 100, 200, 1000, 10_000)
RATIO_BAR, TIME_BAR, MEMORY_BAR = (
    1.5,
    60.0,
    12.0,
)  # CPU time a grain at 1,000 over that at 15; ms a grain and GB at 10,000
POWER_BAR = 0.15  # CPU time a grain at 10,000 over that at 100 is at most this power of the ratio of their numbers
REPEATS, MAX_REPEATED_GRAINS = 3, 1000  # the least of so many runs counts, up to so many grains
MAX_PLACE_ERROR = (1.0, 10.0)  # voxels, degrees: beyond, a stone is in a wrong place
WRONG_ERROR = (5.0, 0.3, 2.0)  # sd, voxels, degrees: off by more than the sd and more than either, in some component
CHOSEN_VIEWS = {2: [0, 2], 3: [0, 1, 3], 4: [0, 1, 2, 3]}  # of the four views
STAGES = {
    "start": "packing",
    "one body": "fields",
    "affine field": "fields",
    "quadratic field": "fields",
    "free, filter 6": "wide filter",
    "free, filter 2": "last filters",
    "free, filter 0.7": "last filters",
    "free, to the end": "last filters",
    "all": "last filters",
    "classifying the grains": "statuses",
    "alignment": "alignment",
    "uncertainty": "uncertainty",
    "other poses": "other poses",
}
PARTS_OF_JUDGING = {"align_views": "alignment", "refine": "uncertainty", "settle_ambiguities": "other poses"}
GROUPS = (
    "near-symmetries", "packing", "fields", "wide filter", "last filters", "alignment", "uncertainty", "other poses",
    "statuses", "other",
)  # fmt: skip
EXTRAPOLATED = ((1e6, ACROSS), (1e6, 120))  # grains and voxels across, on paper; the latter fill a panel of 16 k


# ---------------------------------------------------------------------- measuring
@contextmanager
def counted() -> Iterator[dict[str, int]]:
    """Rays walked with derivatives and without, and products with the normal matrix, while it lasts."""
    counts = {"slopes": 0, "values": 0, "products": 0}

    def counting(inner: Callable[..., None], name: str, size: Callable[..., int]) -> Callable[..., None]:
        def run(*arguments: Any) -> None:
            counts[name] += size(*arguments)
            inner(*arguments)

        return run

    def rays(*arguments: Any) -> int:
        lines = arguments[2].lines
        return int((lines[:, 3] - lines[:, 2]).sum())

    kernels = {
        "project": counting(walks.project, "values", rays),
        "project_with_derivatives": counting(walks.project_with_derivatives, "slopes", rays),
    }
    jvp = counting(normal_equations.jvp, "products", lambda *arguments: len(arguments[-1]))
    with mock.patch.multiple(walks, **kernels), mock.patch.object(normal_equations, "jvp", jvp):
        yield counts


def work(folder: Path, n: int, views: int) -> dict[str, Any]:
    """Track the state of ``n`` stones that lies in ``folder``."""
    track(*load(folder, 15))  # compiles everything
    grains, scan = load(folder, n)
    scan = scan.select(CHOSEN_VIEWS[views])
    held = sum(held_by(g.volume) + held_by(g.fine) for g in grains.grains)
    begin = time.process_time()
    arrays = GrainArrays.of(grains)
    for row, grain in enumerate(grains.grains):
        known_symmetries(grain, arrays, row)
    symmetries = time.process_time() - begin
    del arrays
    found, costs = min(
        (measured(grains, scan) for _ in range(REPEATS if n <= MAX_REPEATED_GRAINS else 1)), key=lambda m: m[1]["cpu"]
    )
    costs["cpu"] += symmetries
    costs["stages"]["near-symmetries"] = symmetries
    with open(folder / f"truth-{n}.pkl", "rb") as file:
        truth = pickle.load(file)
    shifts = recenter(truth.matrices, truth.translations, truth.centers, found.centers)
    u = (found.translations - shifts) / VOXEL
    w = np.rad2deg(rotation_vector(found.matrices @ truth.matrices.transpose(0, 2, 1)))
    good = (np.linalg.norm(u, axis=1) < MAX_PLACE_ERROR[0]) & (np.linalg.norm(w, axis=1) < MAX_PLACE_ERROR[1])
    sd = np.sqrt(np.diagonal(found.covariances, axis1=1, axis2=2))
    off = np.abs(u) > np.maximum(WRONG_ERROR[0] * sd[:, :3] / VOXEL, WRONG_ERROR[1])
    off |= np.abs(w) > np.maximum(WRONG_ERROR[0] * np.rad2deg(sd[:, 3:]), WRONG_ERROR[2])
    return {
        "n": n,
        "views": views,
        "panel": scan.geometry.shape[0],
        **costs,
        "memory": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024,
        "held": held + scan.line_integrals.nbytes,
        "voxels": rms(u[good]),
        "degrees": rms(w[good]),
        "sd": [float(np.nanmedian(sd[:, :3])) / VOXEL, float(np.rad2deg(np.nanmedian(sd[:, 3:])))],
        "converged": int(found.ok.sum()),
        "lost": int((~good).sum()),
        "wrong": int((off.any(axis=1) & found.ok).sum()),
    }


def measured(grains: GrainSet, scan: Scan) -> tuple[Motions, dict[str, Any]]:
    """Motions, and CPU seconds in all and by stage, steps and counts."""
    stages, last = dict.fromkeys(GROUPS, 0.0), ["start", time.process_time()]
    steps = 0

    def progress(message: str, done: int, total: int) -> None:
        nonlocal steps
        now = time.process_time()
        stages[STAGES.get(last[0], "other")] += now - last[1]
        last[:] = [message.split(":")[0], now]
        steps += ": residual" in message

    def told(inner: Callable[..., Any], part: str) -> Callable[..., Any]:
        def run(*arguments: Any) -> Any:
            progress(part, 0, 0)
            result = inner(*arguments)
            progress("classifying the grains", 0, 0)
            return result

        return run

    parts = {name: told(vars(attempt)[name], part) for name, part in PARTS_OF_JUDGING.items()}
    with counted() as counts, mock.patch.multiple(attempt, **parts):
        begin = time.process_time()
        found = track(grains, scan, progress=progress)
        cpu = time.process_time() - begin
    progress("end", 0, 0)
    return found, {"cpu": cpu, "stages": stages, "steps": steps, "counts": counts}


def save(folder: Path, n: int) -> None:
    """Make a crowd and keep it as files, its voxels as the two arrays that hold them."""
    made = crowd(n)
    rows = []
    for grain in made.grains.grains:
        assert grain.fine is not None
        parts = [(v.array.shape, v.voxel_size, v.center) for v in (grain.volume, grain.fine)]
        rows.append((grain.label, grain.center, parts))
    first = made.grains.grains[0]
    for name, volume in (("coarse", first.volume), ("fine", first.fine)):
        assert volume is not None
        np.save(folder / f"{name}-{n}.npy", volume.array.base)
    for name, part in (("grains", rows), ("scan", made.scan), ("truth", made.truth)):
        with open(folder / f"{name}-{n}.pkl", "wb") as file:
            pickle.dump(part, file)


def load(folder: Path, n: int) -> tuple[GrainSet, Scan]:
    """Grains, laid together or kept compactly as `grains_from_labels` leaves them, and the state."""
    files = [folder / f"{name}-{n}.npy" for name in ("coarse", "fine")]
    compact, ends, grains = files[1].stat().st_size > MAX_CUT_BYTES, [0, 0], []
    whole = [] if compact else [np.load(file) for file in files]
    with open(folder / f"grains-{n}.pkl", "rb") as file:
        rows = pickle.load(file)
    for label, center, parts in rows:
        volumes = []
        for k, (shape, voxel_size, middle) in enumerate(parts):
            start, ends[k] = ends[k], ends[k] + int(np.prod(shape))
            flat = _read(files[k], start, ends[k]) if compact else whole[k][start : ends[k]]
            volume = Volume(flat.reshape(shape), voxel_size, middle)
            volumes.append(CompactVolume.of(volume) if compact else volume)
        grains.append(Grain(label, volumes[0], center, fine=volumes[1]))
    with open(folder / f"scan-{n}.pkl", "rb") as file:
        return GrainSet(tuple(grains)), pickle.load(file)


def _read(file: Path, start: int, end: int) -> NDArray[np.float32]:
    """A part of an array in a file; a mapped file would count as memory of the process."""
    with open(file, "rb") as stream:
        np.lib.format.read_magic(stream)
        np.lib.format.read_array_header_1_0(stream)
        return np.fromfile(stream, np.float32, end - start, offset=4 * start)


def held_by(volume: Volume | CompactVolume | None) -> int:
    """Memory of a grain's voxels."""
    if volume is None:
        return 0
    return volume.nbytes if isinstance(volume, CompactVolume) else volume.array.nbytes


def run(n: int, folder: Path, views: int) -> dict[str, Any]:
    """Make a crowd and track it, each in a process of its own."""

    def apart(what: str) -> str:
        command = [
            sys.executable,
            "-m",
            "validation.benchmarks.many_grains",
            what,
            str(folder),
            "--sizes",
            str(n),
            "--views",
            str(views),
        ]
        environment = os.environ | {"NUMBA_NUM_THREADS": "1"}
        return subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True, env=environment, cwd=ROOT).stdout

    if not (folder / f"truth-{n}.pkl").exists():
        print(f"{n} stones: making them ...", flush=True)
        apart("--make")
    print(f"{n} stones: tracking ...", flush=True)
    outcome = json.loads(apart("--work").strip().splitlines()[-1])
    print(json.dumps(outcome), flush=True)
    return outcome


# ---------------------------------------------------------------------- on paper
def power(found: list[dict[str, Any]], value: Callable[[dict[str, Any]], float]) -> tuple[float, float]:
    """a, b of value ≈ a n^b over the larger sizes."""
    some = [f for f in found if f["n"] > 100]
    if len(some) < 2:
        return float(value(found[-1])), 0.0
    b, a = np.polyfit(np.log([f["n"] for f in some]), np.log([value(f) for f in some]), 1)
    return float(np.exp(a)), float(b)


def on_paper(found: list[dict[str, Any]], n: float, across: float) -> dict[str, float]:
    """What `n` grains of so many voxels would take: rays with the area of their shadows, voxels with their volume."""
    a, b = power(found, lambda f: f["cpu"])
    largest = found[-1]
    area, volume = (across / ACROSS) ** 2, (across / ACROSS) ** 3
    walk = largest["held"] / largest["n"] * volume
    patches = max(largest["memory"] - largest["held"], 0.0) / largest["n"] * area
    panel = largest["panel"] * (n / largest["n"]) ** (1 / 3) * across / ACROSS
    # a ray's samples grow with the grain, all else with its pixels; the former are half of the time
    return {
        "cpu": a * n**b * area * (0.5 + 0.5 * across / ACROSS),
        "voxels": n * walk,
        "patches": n * patches,
        "panel": panel,
        "radiographs": 16 * panel**2,
    }


# ---------------------------------------------------------------------- writing
def plot(found: list[dict[str, Any]]) -> None:
    """CPU time and memory against the number of grains, with the orders beside them."""
    n = np.array([f["n"] for f in found], dtype=float)
    cpu, memory = np.array([f["cpu"] for f in found]), np.array([f["memory"] for f in found]) / 1e9
    wide = np.geomspace(n[0], 1e6, 50)
    figure, (left, right) = plt.subplots(1, 2, figsize=(9, 3.6))
    left.loglog(n, cpu, "o-", label="measured")
    left.loglog(wide, cpu[1] * wide / n[1], ":", label="n")
    left.loglog(wide, cpu[1] * (wide / n[1]) ** (4 / 3), "--", label="n$^{4/3}$ (blocks of overlaps)")
    left.loglog(wide, cpu[1] * np.maximum(wide / n[1], 1e-9) ** 3, "-.", lw=0.8, label="n$^3$ (dense factor)")
    a, b = power(found, lambda f: f["cpu"])
    left.loglog(wide[wide > n[-1]], a * wide[wide > n[-1]] ** b, lw=0.8, label=f"fit, n$^{{{b:.2f}}}$")
    left.set(xlabel="grains", ylabel="CPU s a state", ylim=(0.3, 3e5))
    right.loglog(n, memory, "o-", label="peak of the process")
    right.loglog(n, [f["held"] / 1e9 for f in found], "s--", label="grain voxels and radiographs")
    right.axhline(MEMORY_BAR, color="k", lw=0.5)
    right.set(xlabel="grains", ylabel="GB")
    for axes in (left, right):
        axes.legend(frameon=False, fontsize=8)
    figure.tight_layout()
    figure.savefig(PLOT, dpi=110)


def page(found: list[dict[str, Any]], missed: list[str], busy: bool) -> str:
    """The table."""
    rows = [
        f"| {f['n']:,} | {f['panel']}² | {1e3 * f['cpu'] / f['n']:.0f} | "
        + " | ".join(f"{1e3 * f['stages'][g] / f['n']:.1f}" for g in GROUPS)
        + f" | {f['memory'] / 1e9:.2f} | {f['held'] / 1e9:.2f} | {f['voxels']:.4f} | {f['degrees']:.3f} "
        f"| {f['sd'][0]:.4f}, {f['sd'][1]:.3f} | {f['converged']:,} | {f['lost']} |"
        for f in found
    ]
    counts = [
        f"| {f['n']:,} | {f['steps']} | {f['counts']['slopes'] / f['n']:,.0f} | {f['counts']['values'] / f['n']:,.0f} "
        f"| {f['counts']['products']} |"
        for f in found
    ]
    paper = [(n, across, on_paper(found, n, across)) for n, across in EXTRAPOLATED]
    large = [
        f"| {n:,.0f} | {across:g} | {p['panel']:,.0f}² | {p['cpu'] / 3600:,.0f} | {p['cpu'] / 3600 / 128:,.1f} "
        f"| {p['voxels'] / 1e12:.2f} | {p['patches'] / 1e12:.2f} | {p['radiographs'] / 1e9:.1f} |"
        for n, across, p in paper
    ]
    b = power(found, lambda f: f["cpu"])[1]
    lines = [
        "# Cost against the number of grains",
        "",
        "One state of 4 views, simulated without voxels: stones about 14 voxels across, each with a motion of its",
        "own of up to 2 voxels and 4° beside a strain of 1 %, zero start, default settings, one thread.  Samples are",
        "settled heaps of 48 stones, stacked in columns (`crowd.py`); references are the true attenuation of each",
        "voxel with noise, labels are true.",
        "",
        "| grains | panel | CPU ms a grain | " + " | ".join(GROUPS) + " | peak, GB | voxels and radiographs, GB "
        "| u, voxel | ω, ° | median stated sd | converged | misplaced |",
        "|" + "---|" * (10 + len(GROUPS)),
        *rows,
        "",
        "*Near-symmetries* of the grains are found once for all states.",
        "",
        "Errors are root mean square a component of the stones that are not misplaced (beyond 1 voxel or 10°).",
        "They grow with the number of stones on a ray, because the detector's noise stays while each stone's share of",
        "the line",
        "integral falls; so do the standard deviations.",
        "",
        "| grains | steps, all stages | rays a grain with derivatives | without | products with JᵀJ |",
        "|---|---|---|---|---|",
        *counts,
        "",
        f"CPU time grows as n^{b:.2f} beyond 100 grains.  Walks, filters and patches are O(n); products with the",
        "normal matrix are, too, but their number grows with the grains on a ray, and so do the steps until the last",
        "of a crowd are in place.  Blocks of that matrix, which are not made, would be O(n^(4/3)), a dense factor",
        "O(n³).",
        "",
        f"![CPU time and memory against the number of grains](../../../docs/images/{PLOT.name})",
        "",
        "On paper, from the fit and from bytes a grain of the largest size measured; 128 workers of one core each:",
        "",
        "| grains | voxels across | panel | CPU hours | hours on 128 | voxels, TB | patches, TB | radiographs, GB |",
        "|---|---|---|---|---|---|---|---|",
        *large,
        "",
        f"Bars: CPU time a grain at 1,000 at most {RATIO_BAR} times that at 15; {TIME_BAR:g} ms a grain and "
        f"{MEMORY_BAR:g} GB at 10,000; time a grain as n^{POWER_BAR} from 100 to 10,000.  "
        + ("Missed: " + "; ".join(missed) + "." if missed else "Met")
        + (
            ""
            if missed
            else "."
            if found[-1]["n"] >= 10_000
            else f", as far as measured: to {found[-1]['n']:,} grains."
        ),
        "",
        f"{machine()}.  Made by `python -m validation.benchmarks.many_grains "
        f"--sizes {' '.join(str(f['n']) for f in found)}`."
        + "  Other jobs ran on the cores beside, which costs CPU time, too."
        * busy,
        "",
    ]
    return "\n".join(lines)


def misses(found: list[dict[str, Any]]) -> list[str]:
    """Sentences on the bars that are missed."""
    by = {f["n"]: f for f in found}
    out = [f"{f['lost']} of {n} stones misplaced" for n, f in by.items() if f["lost"] > 0.01 * n]
    if {15, 1000} <= by.keys():
        ratio = by[1000]["cpu"] / 1000 / (by[15]["cpu"] / 15)
        out += [f"a grain at 1,000 costs {ratio:.2f} times one at 15"] * (ratio > RATIO_BAR)
    if 10_000 in by and (ms := 1e3 * by[10_000]["cpu"] / 10_000) > TIME_BAR:
        out.append(f"{ms:.0f} ms a grain at 10,000")
    if {100, 10_000} <= by.keys():
        growth = np.log(by[10_000]["cpu"] / 10_000 / (by[100]["cpu"] / 100)) / np.log(100)
        out += [f"time a grain grows as n^{growth:.2f} from 100 to 10,000"] * bool(growth > POWER_BAR)
    out += [f"{f['memory'] / 1e9:.1f} GB at {n}" for n, f in by.items() if f["memory"] > MEMORY_BAR * 1e9]
    return out


def main() -> int:
    """Run all sizes, write table and plot, and say whether the bars are met."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--sizes", type=int, nargs="+", default=list(GRAIN_NUMBERS))
    parser.add_argument("--views", type=int, choices=sorted(CHOSEN_VIEWS), default=4)
    parser.add_argument("--keep", type=Path, help="folder in which samples are kept for another run")
    parser.add_argument("--busy", action="store_true", help="say that other jobs ran beside")
    parser.add_argument("--make", type=Path, help=argparse.SUPPRESS)
    parser.add_argument("--work", type=Path, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.make is not None:
        save(options.make, options.sizes[0])
        return 0
    if options.work is not None:
        print(json.dumps(work(options.work, options.sizes[0], options.views)))
        return 0
    with tempfile.TemporaryDirectory() as name:
        folder = options.keep or Path(name)
        folder.mkdir(parents=True, exist_ok=True)
        found = [run(n, folder, options.views) for n in sorted({15, *options.sizes})]
    if options.views < max(CHOSEN_VIEWS):
        return 0
    missed = misses(found)
    RESULT.write_text(page(found, missed, options.busy))
    plot(found)
    print(RESULT.read_text())
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main())
