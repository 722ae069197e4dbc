"""Against full scans: spam's discrete correlation of two full scans, beside tracking from 4 radiographs.

    python -m validation.benchmarks.full_scan [--cases stones] [--states shift random apart] [--seed 0] [--keep FOLDER]

The cases are simulated without voxels, so that the truth is known.  The same later states are seen twice: by
a full scan, reconstructed and correlated with the reference by ``spam-reg``, ``spam-pixelSearch`` and
``spam-ddic`` (from PyPI, in ``.venv-spam``), and by 4 radiographs, tracked by default from a zero start.  All
share one reference scan, its reconstruction and its labels, which count for none of them.  CPU time is
user + system of all threads and child processes, without start-up and compilation.  With ``--keep``, scans,
reconstructions and their CPU times stay in a folder for the next run.  Writes
``validation/benchmarks/results/full_scan.md``; ends with code 1 if a bar is missed.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import textwrap
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from grainmotion.analysis.validation import compare
from grainmotion.io.spam import read_ddic_tsv
from grainmotion.io.tiff import write_tiff
from grainmotion.model.grains import GrainSet
from grainmotion.model.motions import Motions
from grainmotion.model.scan import Scan
from grainmotion.model.volume import Volume
from grainmotion.reconstruction.reconstruct import reconstruct
from grainmotion.segmentation.extraction import grains_from_labels
from grainmotion.segmentation.segment import segment
from grainmotion.simulate import LATER_ANGLES_DEG, Case, gaps, paper_scale, small
from grainmotion.tracking.track import track
from validation.benchmarks.peers.environment import machine
from validation.benchmarks.peers.rtk import filtered_back_projection
from validation.benchmarks.peers.spam_ddic import Pair, make_environment, spam_version
from validation.benchmarks.track_state import ACCURACY_BARS, load, save
from validation.common.warm import compile_kernels

RESULT = Path(__file__).parent / "results" / "full_scan.md"
CASES: dict[str, tuple[str, Callable[[int], Case]]] = {
    "stones": (
        "15 touching gravel stones about 45 voxels across, each of one material, 280 × 180 pixels, 352 views, SNR 50",
        paper_scale,
    ),
    "small": ("6 stones about 20 voxels across, 96 × 72 pixels, 90 views, SNR 50; a first try", small),
}
STATES = ("unmoved", "shift", "random", "apart")
REFERENCE = "reference"
VOLUMES = ("SART", "FDK")
N_RADIOGRAPHS = 4  # radiographs for the tracker
HANN_CUTOFF = 1.0  # cut-off of the Hann window over the ramp filter, as a share of Nyquist's frequency
MAX_STRETCH_PERCENT = 64  # percent
CHOSEN_OPTIONS = ("-ld", "2", "-ug", "-o", "3")  # the most accurate of those tried on the stones' random state
DDIC_OPTIONS: dict[tuple[str, ...], str] = {(): "by default", CHOSEN_OPTIONS: f"`{' '.join(CHOSEN_OPTIONS)}`"}
CPU_BAR = 5.0  # CPU time of a full scan over that of 4 radiographs


HEADING = (
    "The same states, fully scanned, reconstructed and tracked by spam, beside grainmotion from {views} "
    "radiographs.  The samples are simulated without voxels, and all methods share one reference scan and its "
    "labels, which count for none of them."
)
STATE_NOTES = {
    "unmoved": "*unmoved*: nothing moves.",
    "shift": "*shift*: the whole sample moves sideways, by 31 voxels in `stones`.",
    "random": (
        "*random*: each stone by up to 5 voxels and 10° on its own.  Stones then cut into each other, which no "
        "real sample does: where they do, attenuations add up, as the tracker takes them to, and volumes hold what "
        "correlation cannot know."
    ),
    "apart": (
        "*apart*: the same with the sample stretched by the least percentage that keeps all stones apart; "
        "of these states the one to compare large motions by."
    ),
}
NOTES = (
    "Translations and rotations are root mean square over components and over the stones that did not fail.  A "
    "stone that is missing, not converged, off by more than 1 voxel or 5°, or spurious counts as a failure.  SART "
    "is grainmotion's default reconstruction; FDK is RTK's, with a Hann window, and its CPU time is of the filter "
    "alone.  The reference is reconstructed by the same method as the state that spam compares it with.",
    "spam runs one process.  `spam-reg` registers the sample as one body; if it converges, `spam-pixelSearch` goes 7 "
    "voxels around that, else it gets the range of the motions; then comes `spam-ddic`, by default and by "
    "`{chosen}`, the best of the options that were tried on *random* of `stones`.  The time of all three counts, "
    "without start-up and imports.  spam writes each label's centre of mass as its position, but the displacement "
    "beside it is that of the middle of the label's bounding box; it is read so here.  "
    "grainmotion starts from zero without prior knowledge.",
    "The stones are of one material each, so that correlation has their edges only; inner texture would help spam, "
    "which is made for it.  A full scan also shows what changed in shape or broke, which 4 radiographs do not.",
    "Bars, for `stones`: grainmotion without failures, within {voxels:g} voxel and {degrees:g}°, and in at most "
    "1/{cpu:g} of the CPU time of the cheapest full scan.  Missed: {missed}.",
)


# ---------------------------------------------------------------------- the experiment
def apart(case: Case) -> Motions:
    """The random motions with the whole sample stretched, by the least percentage that keeps the stones apart."""
    sample, random = case.sample, case.motions["random"]
    away = sample.centers - sample.centers.mean(axis=0)

    def stretched(percent: int) -> Motions:
        return replace(random, translations=random.translations + percent / 100 * away)

    low, high = 0, MAX_STRETCH_PERCENT
    while high - low > 1:
        middle = (low + high) // 2
        free = gaps(sample.moved(stretched(middle))).min() > 0
        low, high = (low, middle) if free else (middle, high)
    return stretched(high)


@dataclass(frozen=True, eq=False)
class Study:
    """A case with its full scans and their volumes; each is made once and kept in a folder, with its CPU time."""

    case: Case
    folder: Path

    @cached_property
    def motions(self) -> dict[str, Motions]:
        """The case's own true motions, and ``apart``."""
        return {**self.case.motions, "apart": apart(self.case)}

    @property
    def views(self) -> int:
        """Radiographs of a full scan."""
        return self.case.scanner.reference_views

    @property
    def angles_deg(self) -> tuple[float, ...]:
        """Of a full scan."""
        return tuple(np.arange(self.views) * 360.0 / self.views)

    def scan(self, state: str) -> Scan:
        """A full scan of the reference or of a later state, each with a noise of its own."""
        path = self.folder / f"{state}.npz"
        if not path.exists():
            print(f"{state}: simulating its full scan ...", flush=True)
            if state == REFERENCE:
                save(path, self.case.reference())
            else:
                save(path, self.case.state(self.motions[state], self.angles_deg, 100 + STATES.index(state)))
        return load(path)

    def few(self, state: str) -> Scan:
        """The radiographs of a later state that are tracked."""
        return self.case.state(
            self.motions[state], LATER_ANGLES_DEG[N_RADIOGRAPHS], 10 * STATES.index(state) + N_RADIOGRAPHS
        )

    def sart(self, state: str) -> tuple[Volume, float]:
        """A state reconstructed by default, and CPU seconds."""

        def make() -> tuple[NDArray[np.float32], float]:
            scan, grid = self.scan(state), self.case.scanner.grid
            start = time.process_time()
            return reconstruct(scan, grid).volume.array, time.process_time() - start

        return self._kept(f"{state}-sart", make)

    def fdk(self, state: str) -> tuple[Volume, float]:
        """A state reconstructed by RTK's filtered back-projection, and CPU seconds."""

        def make() -> tuple[NDArray[np.float32], float]:
            images = self.scan(state).line_integrals
            return filtered_back_projection(images, self.case.scanner, self.angles_deg, HANN_CUTOFF)[:2]

        return self._kept(f"{state}-fdk", make)

    @cached_property
    def labels(self) -> NDArray[np.int32]:
        """Of the reference."""
        path = self.folder / "labels.npy"
        if not path.exists():
            np.save(path, segment(self.sart(REFERENCE)[0]).labels)
        return np.load(path)

    @cached_property
    def middles(self) -> NDArray[np.float64]:
        """Of the bounding boxes of labels 1, 2, ..., mm, x y z."""
        boxes = ndimage.find_objects(self.labels)
        places = np.array([[(side.start + side.stop - 1) / 2 for side in box] for box in boxes])
        grid = self.case.scanner.grid
        return places[:, ::-1] * grid.voxel_size + grid.origin

    @cached_property
    def grains(self) -> tuple[GrainSet, float]:
        """Of the reference, and the CPU seconds of cutting them out, once for all states."""
        volume, labels = self.sart(REFERENCE)[0], self.labels
        start = time.process_time()
        return grains_from_labels(volume, labels), time.process_time() - start

    def _kept(self, name: str, make: Callable[[], tuple[NDArray[np.float32], float]]) -> tuple[Volume, float]:
        path = self.folder / f"{name}.npz"
        if not path.exists():
            print(f"{name}: reconstructing ...", flush=True)
            array, cpu = make()
            np.savez(path, array=array, cpu=cpu)
        with np.load(path) as file:
            return Volume(file["array"], self.case.scanner.voxel_size), float(file["cpu"])


# ---------------------------------------------------------------------- the methods
@dataclass(frozen=True)
class Row:
    """What a method made of a state."""

    state: str
    method: str
    radiographs: int
    voxels: float
    degrees: float
    failures: int
    grains: int
    rebuild: float
    track: float
    as_written: float = float("nan")
    """Of spam: the translation error, voxels, of the file's displacements at the file's positions."""
    cutting: float = 0.0
    """Of grainmotion: CPU seconds of cutting the grains out, once for all states."""

    @property
    def cpu(self) -> float:
        """Seconds from the state's radiographs to its motions."""
        return self.rebuild + self.track

    @property
    def ours(self) -> bool:
        """Whether it is tracked from a few radiographs."""
        return self.radiographs == N_RADIOGRAPHS


def judged(study: Study, state: str, method: str, radiographs: int, motions: Motions, cpu: tuple[float, float]) -> Row:
    """A row; ``cpu`` is of the reconstruction and of the tracking."""
    truth = study.motions[state]
    errors = compare(motions, truth, study.case.scanner.voxel_size)
    failures = errors.failures + len(errors.spurious)
    found = errors.translation_rms_voxels, errors.rotation_rms_deg
    return Row(state, method, radiographs, *found, failures, len(truth), *cpu)


def measured(study: Study, state: str, volumes: Sequence[str]) -> list[Row]:
    """All methods on a state."""
    return [*(row for name in volumes for row in by_spam(study, state, name)), by_few(study, state)]


def by_spam(study: Study, state: str, reconstruction: str) -> list[Row]:
    """spam on two reconstructions, by its default options and by the chosen ones.

    spam 0.9.1 writes each label's centre of mass as its position, but the displacement beside it is that of
    the middle of the label's bounding box, and is read so here; the error of the file as written is given as well.
    """
    h, grid = study.case.scanner.voxel_size, study.case.scanner.grid
    # Range of the motions along z, y and x, which a user of spam has to give; here it is taken from the truth.
    reach = np.ceil(np.abs(study.motions[state].translations).max(axis=0)[::-1] / h).astype(int) + 2
    volume = {"SART": study.sart, "FDK": study.fdk}[reconstruction]
    rows = []
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        (before, _), (after, rebuild) = volume(REFERENCE), volume(state)
        pair = Pair(folder / "reference.tif", folder / "labels.tif", folder / "state.tif", folder)
        write_tiff(pair.reference, before.array)
        write_tiff(pair.labels, study.labels.astype(np.uint32))
        write_tiff(pair.state, after.array)
        start, approach = pair.approach(reach.tolist())
        for options, description in DDIC_OPTIONS.items():
            tsv, cpu = pair.correlate(start, options)
            written = read_ddic_tsv(tsv, grid)
            motions = replace(written, centers=study.middles[written.labels - 1])
            what = study, state, f"{reconstruction}, spam-ddic {description}", study.views
            as_written = judged(*what, written, (rebuild, approach + cpu)).voxels
            rows.append(replace(judged(*what, motions, (rebuild, approach + cpu)), as_written=as_written))
            print(rows[-1], flush=True)
    return rows


def by_few(study: Study, state: str) -> Row:
    """Tracking from a few radiographs, all by default."""
    scan, (grains, cutting) = study.few(state), study.grains
    start = time.process_time()
    motions = track(grains, scan)
    cpu = time.process_time() - start
    row = judged(study, state, f"**grainmotion**, {N_RADIOGRAPHS} radiographs", N_RADIOGRAPHS, motions, (0.0, cpu))
    row = replace(row, cutting=cutting)
    print(row, flush=True)
    return row


# ---------------------------------------------------------------------- the table
def misses(rows: list[Row]) -> list[str]:
    """The bars that a state's rows miss, in words."""
    ours = next(row for row in rows if row.ours)
    voxels, degrees = ACCURACY_BARS[N_RADIOGRAPHS]
    found = []
    if ours.failures:
        found.append(f"{ours.state}: {ours.failures} failures")
    if not (ours.voxels <= voxels and ours.degrees <= degrees):
        found.append(f"{ours.state}: errors")
    if not min(row.cpu for row in rows if not row.ours) >= CPU_BAR * ours.cpu:
        found.append(f"{ours.state}: CPU time")
    return found


def table(rows: list[Row]) -> list[str]:
    """Markdown lines."""
    ours = {row.state: row for row in rows if row.ours}
    return [
        "| state | method | radiographs | translation, voxel | rotation, ° | failures "
        "| reconstruction, CPU s | tracking, CPU s | total, CPU s | total over ours |",
        "|---|---|---|---|---|---|---|---|---|---|",
        *(
            f"| {row.state} | {row.method} | {row.radiographs} | {row.voxels:.4f} | {row.degrees:.3f} "
            f"| {row.failures}/{row.grains} | {f'{row.rebuild:.1f}' if row.rebuild else '–'} | {row.track:.1f} "
            f"| {row.cpu:.1f} | {row.cpu / ours[row.state].cpu:.0f} |"
            for row in rows
        ),
    ]


def paragraph(text: str) -> list[str]:
    """Lines of Markdown and an empty one."""
    return [*textwrap.wrap(text, 108, break_long_words=False, break_on_hyphens=False), ""]


def missed_bars(results: dict[str, list[Row]]) -> list[str]:
    """What `stones` miss, in words."""
    rows = results.get("stones", [])
    return [
        line for state in dict.fromkeys(r.state for r in rows) for line in misses([r for r in rows if r.state == state])
    ]


def page(results: dict[str, list[Row]], missed: list[str], command: str) -> str:
    """The results as Markdown."""
    lines = ["# Against full scans", "", *paragraph(HEADING.format(views=N_RADIOGRAPHS))]
    for name, rows in results.items():
        lines += [f"`{name}`: {CASES[name][0]}.", "", *table(rows), ""]
        written = [
            f"{row.as_written:.3f} ({row.state}, {row.method.split(',')[0]})"
            for row in rows
            if row.method.endswith(DDIC_OPTIONS[CHOSEN_OPTIONS])
        ]
        lines += paragraph(
            f"Taken at the positions in its file (see below), spam's translations by "
            f"{DDIC_OPTIONS[CHOSEN_OPTIONS]} are off by {', '.join(written)} voxel.  Once for all states "
            f"grainmotion took {max(row.cutting for row in rows):.1f} CPU s more, "
            "to cut the grains out of the reference on finer voxels."
        )
    for state in dict.fromkeys(row.state for rows in results.values() for row in rows):
        lines += paragraph(STATE_NOTES[state])
    voxels, degrees = ACCURACY_BARS[N_RADIOGRAPHS]
    filled = {"chosen": " ".join(CHOSEN_OPTIONS), "voxels": voxels, "degrees": degrees, "cpu": CPU_BAR}
    for note in NOTES:
        lines += paragraph(note.format(**filled, missed="; ".join(missed) or "none"))
    return "\n".join([*lines, f"{machine()}, spam {spam_version()}.  Made by `{command}`.", ""])


def main() -> int:
    """Run all cases, write the tables, and say whether the bars are met."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--cases", nargs="+", choices=sorted(CASES), default=["stones"])
    parser.add_argument("--states", nargs="+", choices=STATES, default=list(STATES[1:]))
    parser.add_argument("--volumes", nargs="+", choices=VOLUMES, default=list(VOLUMES))
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--keep", type=Path, help="folder in which scans and reconstructions stay")
    parser.add_argument("--out", type=Path, default=RESULT)
    options = parser.parse_args()
    make_environment()
    compile_kernels()

    results: dict[str, list[Row]] = {}
    for name in options.cases:
        with tempfile.TemporaryDirectory() as place:
            folder = (options.keep or Path(place)) / f"{name}-{options.seed}"
            folder.mkdir(parents=True, exist_ok=True)
            study = Study(CASES[name][1](options.seed), folder)
            results[name] = [row for state in options.states for row in measured(study, state, options.volumes)]
    missed = missed_bars(results)
    said = (
        f"--cases {' '.join(options.cases)} --states {' '.join(options.states)} --volumes {' '.join(options.volumes)}"
    )
    text = page(results, missed, f"python -m validation.benchmarks.full_scan {said} --seed {options.seed}")
    options.out.parent.mkdir(exist_ok=True)
    options.out.write_text(text)
    print(text)
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main())
