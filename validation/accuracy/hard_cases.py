"""Hard cases: experiments that each break one assumption, tracked by default and as a user would choose."""

from __future__ import annotations

import re
from collections import Counter
from dataclasses import dataclass
from functools import lru_cache

from grainmotion.calibration.calibrate import calibrate
from grainmotion.model.grains import GrainSet
from grainmotion.model.scan import Scan
from grainmotion.model.volume import Volume
from grainmotion.preprocessing.beam_hardening import calibrate_hardening
from grainmotion.reconstruction.reconstruct import reconstruct
from grainmotion.segmentation.extraction import grains_from_labels
from grainmotion.segmentation.segment import segment
from grainmotion.simulate import HARD_CASES, LABORATORY_CASES, LATER_ANGLES_DEG, HardCase, hard_case
from grainmotion.workflow.calibration_stage import ScannerCalibration
from validation.accuracy import page
from validation.accuracy.outcomes import Outcome, Pool, counted, measure, pool
from validation.accuracy.remedies import Remedy, remedies
from validation.common.cache import RECONSTRUCTION, TRACKING
from validation.common.trials import run_trials

NAMES = tuple(name for name in HARD_CASES if name not in LABORATORY_CASES)
"""Laboratory samples have a study of their own."""
SEEDS = range(1)
VIEWS = (4, 2)
HARDENING_ROUNDS = 2  # of the curve of beam hardening, as a run does it
NAMING_WORDS = {"missing": r"is missing|gone|not on the radiographs", "broken": r"is broken|broken? in|not its shape"}
"""Words of a sentence that names what happened to this grain, not only the grain among others."""


@dataclass(frozen=True)
class Trial:
    """One case of one seed, and the ways to track it."""

    name: str
    seed: int
    remedies: tuple[Remedy, ...]


@dataclass(frozen=True)
class Found:
    """An outcome, and the labels of the grains that are gone or broken."""

    outcome: Outcome
    marked: tuple[int, ...] = ()


Results = dict[str, list[dict[tuple[str, int], Found]]]
"""By case, seed, and remedy and views."""


def trial(job: Trial) -> dict[tuple[str, int], Found]:
    """The outcomes, by the remedy's name and views."""
    made = case(job.name, job.seed)
    marked = made.missing + made.broken
    return {
        (r.name, views): Found(tracked(job.name, job.seed, r, views), marked) for r in job.remedies for views in VIEWS
    }


@lru_cache(maxsize=1)
def case(name: str, seed: int) -> HardCase:
    """The case at the small scale."""
    return hard_case(name, seed)


@page.PAGE.cached(*TRACKING)
def tracked(name: str, seed: int, remedy: Remedy, views: int) -> Outcome:
    """The later state, tracked in one way."""
    made = case(name, seed)
    volume, scanner = reference(name, seed, remedy.calibrated)
    sample = grains(volume, remedy)
    scan = scanner.apply(made.state(LATER_ANGLES_DEG[views]))
    return measure(sample, scan, made.motions, made.case.scanner.voxel_size, remedy.settings)


def grains(volume: Volume, remedy: Remedy) -> GrainSet:
    """The grains of a reference, by default segmentation."""
    return grains_from_labels(volume, segment(volume).labels, background=remedy.background)


@lru_cache(maxsize=2)
def reference(name: str, seed: int, calibrated: str) -> tuple[Volume, ScannerCalibration]:
    """The reference, reconstructed, and the calibration that corrects every scan of the scanner."""
    made, scanner = case(name, seed), ScannerCalibration()
    grid, scan = made.case.scanner.grid, made.reference()
    if calibrated == "geometry":
        scanner = ScannerCalibration(calibration=calibrate(scan, grid))
    volume = _reconstructed(scanner.apply(scan), grid)
    for _ in range(HARDENING_ROUNDS if calibrated == "hardening" else 0):
        curve = calibrate_hardening(scan, volume, labels=segment(volume).labels)
        scanner = ScannerCalibration(hardening=curve)
        volume = _reconstructed(scanner.apply(scan), grid)
    return volume, scanner


@page.PAGE.cached(*RECONSTRUCTION)
def _reconstructed(scan: Scan, grid: Volume) -> Volume:
    """By default; cached, as remedies share it."""
    return reconstruct(scan, grid).volume


# ---------------------------------------------------------------------- the page
def study() -> page.Section:
    """All cases."""
    jobs = [Trial(name, seed, remedies(name)) for name in NAMES for seed in SEEDS]
    done = run_trials(trial, jobs, page.PROCESSES)
    return section({name: [d for job, d in zip(jobs, done) if job.name == name] for name in NAMES})


def section(results: Results) -> page.Section:
    """The tables of all cases."""
    head = ["case", "tracked", "views", "rms u, voxel", "rms ω, °", "errors / predicted sd: u, ω"]
    head += ["statuses", "failures", "wrongly converged", "CPU s"]
    pools = {(name, *key): together(results, name, *key) for name in results for key in results[name][0]}
    rows = [[name, tracked, views, *cells(some)] for (name, tracked, views), some in pools.items()]
    wrong = {key: some.wrong for key, some in pools.items()}
    default = sum(n for key, n in wrong.items() if key[1] == "default")
    where = ", ".join(f"{n} in {' / '.join(map(str, key))}" for key, n in wrong.items() if n)
    cases = "\n".join(f"- *{name}*: {HARD_CASES[name].summary}" for name in results)
    text = f"""Each case of `simulate.HARD_CASES`, but for laboratory samples, at its small scale (stones about 20
voxels across, random motions of up to 5 voxels and 10° unless the case has its own; SNR 50 unless stated),
{len(SEEDS)} packing each, reconstructed, segmented and tracked from a zero start by default settings; and, where the
case calls for it, with the setting that a user would choose.
*calibrated* is `calibrate` or `calibrate_hardening` on the reference scan.

{cases}

Root mean squares are over components and over the grains that converged; *failures* are grains that did not converge,
are off by more than 1 voxel or 5°, or are no grain; *wrongly converged* are grains that converged and are off by more
than 5 own standard deviations, and 0.3 voxel or 2°, in any component: there should be none.  Grains that are truly gone
or broken are left out here.  CPU seconds are of tracking one state.

{page.table(head, rows)}
Wrongly converged in all: {sum(wrong.values())}{f" ({where})" if where else ""}.

### Grains that are gone or broken

What became of them, one a seed; *named* counts the states where the grain's sentence, or a note on the state, names
what happened.

{_marked(results)}"""
    headline = (
        f"{default} grains of {len(results)} cases wrongly converged by default settings, "
        f"{sum(wrong.values()) - default} with others"
    )
    return page.Section("Hard cases", text, headline)


def together(results: Results, name: str, tracked: str, views: int) -> Pool:
    """All grains of a case tracked in one way, except those that are gone or broken."""
    found = [seed[tracked, views] for seed in results[name]]
    return pool([f.outcome for f in found], [f.marked for f in found])


def cells(some: Pool) -> list[str]:
    """Errors and statuses of some grains, for a table."""
    (voxels, degrees), (over, over_rotation) = some.rms, some.over_sd
    errors = [page.number(voxels, 4), page.number(degrees, 3)]
    own = f"{page.number(over, 2)}, {page.number(over_rotation, 2)}"
    failures = f"{some.failures}/{len(some.statuses)}"
    return [*errors, own, some.counts(), failures, str(some.wrong), f"{some.cpu:.1f}"]


def _marked(results: Results) -> str:
    rows, sentences = [], Counter[tuple[str, str]]()
    for name in results:
        for key in results[name][0]:
            found = [seed[key] for seed in results[name] if seed[key].marked]
            if not found:
                continue
            mine = [one_grain(f) for f in found]
            shown = sum(
                bool(re.search(NAMING_WORDS[name], " ".join([reason, *f.outcome.notes])))
                for (_, reason), f in zip(mine, found)
            )
            rows.append([name, *key, counted([status for status, _ in mine]), f"{shown} of {len(found)}"])
            for status, reason in mine:
                sentences[name, f"{status}: {_plain(reason)}" if reason else status] += 1
            for f in found:
                sentences.update((name, f"note: {_plain(note)}") for note in f.outcome.notes)
    sentence_list = "\n".join(f"- *{name}*, {n} times: {sentence}" for (name, sentence), n in sorted(sentences.items()))
    head = ["case", "tracked", "views", "status of the grain", "named"]
    return f"{page.table(head, rows)}\nTheir sentences and notes, numbers left out:\n\n{sentence_list}"


def one_grain(found: Found) -> tuple[str, str]:
    """Status and sentence of the grain that is gone or broken."""
    row = found.outcome.labels.index(found.marked[0])
    return found.outcome.statuses[row], found.outcome.reasons[row]


def _plain(sentence: str) -> str:
    return re.sub(r"-?\d[\d.e+-]*", "…", sentence)
