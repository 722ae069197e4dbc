"""Laboratory samples: cut off, wet, between pistons, soft, of many sizes, by the library's default chain.

Grains of a reference, scores and bounds are cached one by one, so that a stopped run continues.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from grainmotion.model.grains import GrainSet
from grainmotion.simulate import HARD_CASES, LABORATORY_CASES, LATER_ANGLES_DEG, HardCase, hard_case, motion_bounds
from validation.accuracy import page
from validation.accuracy.laboratory_scores import (
    BARS,
    LIE_DEG,
    LIE_SDS,
    LIE_VOXELS,
    MIN_COVERAGE,
    Float,
    Score,
    coverage,
    rms_of_good,
    shortfalls,
    timed_reference,
    together,
    tracked,
)
from validation.accuracy.specimens import in_voxels_and_degrees
from validation.common.cache import SEGMENTATION, SIMULATION, TRACKING
from validation.common.trials import run_trials
from validation.common.warm import compile_kernels

SAMPLES = 5
VIEWS = (4, 2)
FIRST_SEED = 3
UNBOUNDED = ("soft",)
"""Cases of which no bound on rigid motions is defined."""


@dataclass(frozen=True)
class Trial:
    """One case of one seed."""

    name: str
    seed: int


@dataclass(frozen=True, eq=False)
class Outcome:
    """Score of a state, and the noise's bounds on the motions of its grains ``(n, 6)``: voxels and degrees."""

    score: Score
    bounds: Float


Results = dict[str, dict[int, list[Outcome]]]
"""By case and views, a seed each."""


def trial(job: Trial) -> dict[int, Outcome]:
    """The outcomes, by views."""
    return {views: Outcome(outcome(job.name, job.seed, views), bounds(job.name, job.seed, views)) for views in VIEWS}


@lru_cache(maxsize=1)
def made(name: str, seed: int) -> HardCase:
    """The case, at the larger scale."""
    return hard_case(name, seed, scale="paper")


@page.PAGE.cached(*TRACKING)
def outcome(name: str, seed: int, views: int) -> Score:
    """The score of the later state; an exception is one, too."""
    compile_kernels()
    try:
        grains, seconds = reference(name, seed)
        found = tracked(made(name, seed), grains, views)
        return replace(found, cpu=found.cpu + seconds)
    except Exception as error:
        case = made(name, seed)
        return Score(
            present=len(case.motions) - len(case.missing),
            whole=int(case.whole(LATER_ANGLES_DEG[views]).sum()),
            error=f"{type(error).__name__}: {error}",
        )


@lru_cache(maxsize=1)
@page.PAGE.cached(*SEGMENTATION, "calibration", "diagnosis")
def reference(name: str, seed: int) -> tuple[GrainSet, float]:
    """The grains of the reference, and CPU seconds."""
    return timed_reference(made(name, seed))


@page.PAGE.cached(*SIMULATION)
def bounds(name: str, seed: int, views: int) -> Float:
    """Cramér–Rao bounds on the standard deviations of each grain ``(n, 6)``, NaN where there is none."""
    case = made(name, seed)
    out = np.full((len(case.motions), 6), np.nan)
    if name not in UNBOUNDED:
        here = ~np.isin(case.motions.labels, case.missing)
        covariances = motion_bounds(case.later, case.true_geometry(LATER_ANGLES_DEG[views]), case.case.physics)
        sd = np.sqrt(np.diagonal(covariances, axis1=1, axis2=2))
        out[here] = in_voxels_and_degrees(sd, case.case.scanner.voxel_size)
    return out


# ---------------------------------------------------------------------- the page
def study(samples: int = SAMPLES) -> page.Section:
    """All cases, ``samples`` seeds of each."""
    jobs = [Trial(name, seed) for seed in range(FIRST_SEED, FIRST_SEED + samples) for name in LABORATORY_CASES]
    done = run_trials(trial, jobs)
    results: Results = {name: {views: [] for views in VIEWS} for name in LABORATORY_CASES}
    for job, found in zip(jobs, done, strict=True):
        for views in VIEWS:
            results[job.name][views].append(found[views])
    return section(results)


def section(results: Results) -> page.Section:
    """The table, the lies and what went wrong."""
    head = ["case", "views", "grains (whole)", "found", "statuses", "rms u, voxel", "bound", "rms ω, °", "bound"]
    head += ["errors / sd", "coverage", "lies", "bar", "lacks", "CPU s"]
    rows = [row(name, views, some) for name, by_views in results.items() for views, some in by_views.items()]
    cases = "\n".join(f"- *{name}*: {HARD_CASES[name].summary}" for name in results)
    seeds = max(len(some) for by_views in results.values() for some in by_views.values())
    met = sum(not lacks(name, by_views[4]) for name, by_views in results.items())
    lies = sum(len(o.score.lies) for by_views in results.values() for some in by_views.values() for o in some)
    text = f"""Samples as laboratories have them (`simulate.LABORATORY_CASES`, the larger scale): stones 20 voxels
across, 90 views for the reference, SNR 50; {seeds} packings each, with states of 4 and 2 views, by the library's
default chain (`calibrate`, `reconstruct`, `segment`, `grains_from_labels`, `track`), from a zero start.

{cases}

*Grains* are those that are there in the later state, *whole* those whose shadows are wholly on the panel in all
radiographs of both states.  Errors are root mean squares of a component over the grains that converged (or whose
translation, or rotation, is told as good though the other is not), *bound* the Cramér–Rao bound of the radiographs'
noise for the same grains (`simulate.motion_bounds`, given the true shapes).  *Coverage* is the share of errors within
1.96 standard deviations (at least {MIN_COVERAGE:.0%} wanted, 90 % of *settling*).  *Lies* are motions told as good that
are off by more than {LIE_SDS:g} standard deviations, and {LIE_VOXELS:g} voxel or {LIE_DEG:g}°, or of grains that are
missing or no grains at all.  The *bar* is for 4 views; of *materials* for the dense grains.  CPU seconds are of the
whole chain, reference and one state.

{page.table(head, rows)}
{_sentences(results)}"""
    headline = f"{met} of {len(results)} kinds of sample reach their bar, {lies} confident lies"
    return page.Section("Laboratory samples", text, headline)


def row(name: str, views: int, some: list[Outcome]) -> list[str]:
    """One case and number of views, for the table."""
    scores = [o.score for o in some]
    errors, sds, _ = together(scores)
    least = np.concatenate([o.bounds[o.score.rows] for o in some])
    least[np.isnan(errors)] = np.nan
    bound = [rms_of_good(least[:, part]) for part in (slice(3), slice(3, 6))]
    statuses = Counter[str]()
    for one in scores:
        statuses.update(one.statuses)
    counts = ", ".join(f"{n} {word}" for word, n in statuses.most_common())
    present, whole, found = (sum(getattr(s, key) for s in scores) for key in ("present", "whole", "found"))
    return [
        name, str(views), f"{present} ({whole})", str(found), counts or "–",
        page.number(rms_of_good(errors[:, :3]), 4), page.number(bound[0], 4),
        page.number(rms_of_good(errors[:, 3:]), 3), page.number(bound[1], 3),
        page.number(rms_of_good(errors / sds), 2),
        f"{coverage(errors, sds):.0%}" if np.isfinite(errors).any() else "–",
        str(sum(len(s.lies) for s in scores)),
        str(BARS[name]) if views == 4 else "", ("; ".join(lacks(name, some)) or "nothing") if views == 4 else "",
        f"{np.mean([s.cpu for s in scores]):.0f}",
    ]  # fmt: skip


def lacks(name: str, some: list[Outcome]) -> list[str]:
    """What some outcomes lack of the case's bar."""
    return shortfalls(BARS[name], [o.score for o in some])


def _sentences(results: Results) -> str:
    """Lies, exceptions and notes."""
    lines = [
        f"- *{name}*, {views} views, seed {FIRST_SEED + k}: {sentence}"
        for name, by_views in results.items()
        for views, some in by_views.items()
        for k, o in enumerate(some)
        for sentence in [*o.score.lies, *([o.score.error] if o.score.error else [])]
    ]
    return "Lies and exceptions:\n\n" + "\n".join(lines) + "\n" if lines else "There were no lies and no exceptions.\n"
