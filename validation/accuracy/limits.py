"""Limits: ratio of the errors to the Cramér–Rao bound of the photon noise."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from validation.accuracy import page, specimens
from validation.accuracy.outcomes import Float, Outcome, Pool, by_kind, measure, pool
from validation.accuracy.specimens import STATES, Specimen
from validation.common.cache import TRACKING
from validation.common.trials import run_trials

SNRS = (50.0, 10.0)
VIEWS = (4, 2)
SEEDS = {"paper": (0,), "small": (0, 1, 2, 3)}
NAMES = {"paper": "15 stones, 45 voxels", "small": "6 stones, 20 voxels"}


@dataclass(frozen=True)
class Trial:
    """One specimen, and its states by name and views."""

    specimen: Specimen
    states: tuple[tuple[str, int], ...] = tuple((name, views) for name in STATES for views in VIEWS)


@dataclass(frozen=True, eq=False)
class Limited:
    """An outcome, and the Cramér–Rao bounds of its standard deviations ``(n, 6)``: voxels and degrees."""

    outcome: Outcome
    bounds: Float


def trial(job: Trial) -> dict[tuple[str, int], Limited]:
    """The outcomes and bounds, by state and views."""
    return {(name, views): limited(job.specimen, name, views) for name, views in job.states}


def limited(specimen: Specimen, name: str, views: int) -> Limited:
    """One state of a specimen, tracked by default, and its bounds."""
    return Limited(tracked(specimen, name, views), specimens.bounds(specimen, name, views))


@page.PAGE.cached(*TRACKING)
def tracked(specimen: Specimen, name: str, views: int) -> Outcome:
    """One state of a specimen, tracked by default."""
    case = specimens.case(specimen)
    scan = specimens.state(specimen, name, views)
    return measure(specimens.grains(specimen), scan, case.motions[name], case.scanner.voxel_size)


def study() -> page.Section:
    """Both scales, both exposures."""
    jobs = [Trial(Specimen(scale, seed, snr)) for scale, seeds in SEEDS.items() for snr in SNRS for seed in seeds]
    done = run_trials(trial, jobs, page.PROCESSES)
    rows, ratios = [], {}
    for scale in SEEDS:
        for snr in SNRS:
            mine = [d for job, d in zip(jobs, done) if (job.specimen.scale, job.specimen.snr) == (scale, snr)]
            for state in mine[0]:
                some = [d[state] for d in mine]
                rows.append([NAMES[scale], f"{snr:g}", state[0], str(state[1]), *cells(some)])
                ratios[scale, snr, state] = over_bounds(some)
    return section(rows, ratios)


def section(
    rows: list[list[str]], ratios: dict[tuple[str, float, tuple[str, int]], tuple[float, float]]
) -> page.Section:
    """The table, and its averages."""
    head = ["case", "SNR", "state", "views", "rms u, voxel", "bound", "ratio"]
    head += ["rms ω, °", "bound", "ratio", "errors / predicted sd: u, ω", "failures", "wrong", "CPU s"]
    sentences = []
    for scale in dict.fromkeys(key[0] for key in ratios):
        for snr in dict.fromkeys(key[1] for key in ratios if key[0] == scale):
            some = np.array([r for key, r in ratios.items() if key[:2] == (scale, snr)])
            u, rotation = np.exp(np.log(some).mean(axis=0))
            sentences.append(f"{u:.1f} and {rotation:.1f} times ({NAMES[scale]}, SNR {snr:g})")
    text = f"""The Cramér–Rao bound (`simulate.motion_bounds`) is the least standard deviation that any unbiased method
can have, given the true shapes, the photons of the radiographs, and gain and offset unknown.  It assumes
the stones known without voxels and without the noise of the reference, so that no real method reaches it.  The
reference scan has the same SNR as the states: 352 views at the larger scale, 90 at the smaller.  Default settings, zero
start; root mean square over the grains that converged and over components, of errors and bounds alike; the smaller
scale over {len(SEEDS["small"])} packings.

{page.table(head, rows)}
On geometric average over the states, errors of translation and rotation are {"; ".join(sentences)} the bound."""
    headline = f"u and ω are {'; '.join(sentences)} the bound"
    return page.Section("Errors against the bound that noise sets", text, headline)


def over_bounds(some: list[Limited]) -> tuple[float, float]:
    """Errors over bounds, translations and rotations."""
    together, least = _pools(some)
    (u, rotation), (least_u, least_rotation) = together.rms, by_kind(least[together.ok])
    return u / least_u, rotation / least_rotation


def cells(some: list[Limited]) -> list[str]:
    """Errors, bounds and ratios, for a table."""
    together, least = _pools(some)
    errors, bounds, ratios = together.rms, by_kind(least[together.ok]), over_bounds(some)
    parts = [f"{x:.{digits}f}" for k, digits in ((0, 4), (1, 3)) for x in (errors[k], bounds[k])]
    parts = [*parts[:2], f"{ratios[0]:.2f}", *parts[2:], f"{ratios[1]:.2f}"]
    own = "{:.2f}, {:.2f}".format(*together.over_sd)
    return [*parts, own, f"{together.failures}/{len(together.ok)}", str(together.wrong), f"{together.cpu:.1f}"]


def _pools(some: list[Limited]) -> tuple[Pool, Float]:
    return pool([x.outcome for x in some]), np.concatenate([x.bounds for x in some])
