"""Coverage: whether errors are as large as the covariances say."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np
from matplotlib.figure import Figure
from scipy import stats

from grainmotion.simulate import random
from validation.accuracy import page, specimens
from validation.accuracy.outcomes import Float, Outcome, Pool, measure, pool
from validation.accuracy.specimens import Specimen
from validation.common.cache import TRACKING
from validation.common.measures import rms
from validation.common.trials import run_trials

SEEDS = range(12)
SNRS = (50.0, 15.0)
INCLUSIONS = (None, 1.5)
VIEWS = (4, 2)
REPEATS = 2
MAX_MOTION = 3.0, 10.0  # voxels, degrees
SDS_95 = 1.96  # half of the interval that holds 95 % of normal errors
COMPONENTS = ("u_x", "u_y", "u_z", "ω_x", "ω_y", "ω_z")


@dataclass(frozen=True)
class Trial:
    """One specimen, a motion of its own for each of ``repeats`` states and number of views."""

    specimen: Specimen
    repeats: int = REPEATS


def trial(job: Trial) -> dict[int, list[Outcome]]:
    """The outcomes, by views."""
    return {views: [tracked(job.specimen, views, k) for k in range(job.repeats)] for views in VIEWS}


@page.PAGE.cached(*TRACKING)
def tracked(specimen: Specimen, views: int, repeat: int, max_motion: tuple[float, float] = MAX_MOTION) -> Outcome:
    """One state of random motions, tracked by default."""
    number = 1 + 10 * repeat + views
    setting = SNRS.index(specimen.snr) + 2 * INCLUSIONS.index(specimen.inclusion)
    case = specimens.case(specimen)
    h = case.scanner.voxel_size
    voxels, degrees = max_motion
    truth = random(case.sample, voxels * h, degrees, 1000 * specimen.seed + 100 * setting + number)
    return measure(specimens.grains(specimen), specimens.moved(specimen, truth, views, number), truth, h)


def study() -> page.Section:
    """All settings, each by itself and all together."""
    settings = list(product(SNRS, INCLUSIONS))
    jobs = [Trial(Specimen("small", seed, snr, inclusion)) for snr, inclusion in settings for seed in SEEDS]
    done = run_trials(trial, jobs, page.PROCESSES)
    groups = {
        (snr, inclusion, views): [
            o
            for job, found in zip(jobs, done, strict=True)
            if (job.specimen.snr, job.specimen.inclusion) == (snr, inclusion)
            for o in found[views]
        ]
        for (snr, inclusion), views in product(settings, VIEWS)
    }
    whole = pool([o for group in groups.values() for o in group])
    return section({_words(*key): pool(group) for key, group in groups.items()}, whole)


def section(pools: dict[str, Pool], whole: Pool) -> page.Section:
    """Tables and figure of the pooled outcomes."""
    head = ["setting", "grain-states", "not converged", "rms u, voxel", "rms ω, °", *COMPONENTS, "u", "ω"]
    rows = [_row(name, some) for name, some in [*pools.items(), ("**all**", whole)]]
    inside, ratio = coverage(whole.ratios), rms(whole.ratios)
    caption = (
        "Left: errors over predicted standard deviations, and the normal distribution that they should have. "
        "Right: their quantiles against the normal ones."
    )
    text = f"""Whether the covariances in `motions.h5` are true: stones of `simulate.small` (6 stones about 20 voxels
across, 90 views for the reference), tracked by default from a zero start in states of random motions, up to
{MAX_MOTION[0]:g} voxels and {MAX_MOTION[1]:g}°; {len(SEEDS)} packings, each with {len(INCLUSIONS)} kinds of stone
(uniform, and with an inclusion of {INCLUSIONS[1]} times the attenuation), {len(SNRS)} exposures (of reference and
states alike), {len(VIEWS)} numbers of views and {REPEATS} motions.  Rotation errors are log(Ω_measured Ω_trueᵀ), the
increments that the covariances are of.

Each cell: the share of errors within {SDS_95} predicted standard deviations, which should be 95 %; then the root mean
square of errors over predicted standard deviations, which should be 1.  Only grains that converged count,
{int(whole.ok.sum())} in all.

{page.table(head, rows)}
Wrongly converged (off by more than 5 own standard deviations, and 0.3 voxel or 2°): {whole.wrong}.
{_tails(whole.ratios)}

{page.figure("coverage", _draw(whole.ratios), caption)}"""
    headline = (
        f"{inside:.1%} of {whole.ratios.size} errors within {SDS_95} predicted sd (95 % wanted), errors {ratio:.2f} "
        f"times the predicted sd; {whole.wrong} grains wrongly converged"
    )
    return page.Section("Errors against predicted uncertainties", text, headline)


def coverage(ratios: Float) -> float:
    """The share of errors within the 95 % interval."""
    return float(np.mean(np.abs(ratios) < SDS_95)) if ratios.size else float("nan")


def _row(name: str, some: Pool) -> list[str]:
    voxels, degrees = some.rms
    ratios = some.ratios
    parts = [*(ratios[:, k] for k in range(6)), ratios[:, :3], ratios[:, 3:]]
    cells = [f"{coverage(part):.0%}, {rms(part):.2f}" for part in parts]
    return [name, str(len(some.ok)), str(int((~some.ok).sum())), f"{voxels:.4f}", f"{degrees:.3f}", *cells]


def _words(snr: float, inclusion: float | None, views: int) -> str:
    return f"SNR {snr:g}, {'uniform' if inclusion is None else 'inclusions'}, {views} views"


def _tails(ratios: Float) -> str:
    shares = [f"{np.mean(np.abs(ratios) > k):.2%} beyond {k} (normal: {2 * stats.norm.sf(k):.2%})" for k in (3, 4)]
    mean = ", ".join(f"{name} {m:+.2f}" for name, m in zip(COMPONENTS, ratios.mean(axis=0), strict=True))
    return f"Of the ratios {', '.join(shares)}; their means: {mean}."


def _draw(ratios: Float) -> Figure:
    image = Figure(figsize=(10, 4.2))
    left, right = image.subplots(1, 2)
    edges = np.linspace(-5, 5, 61)
    left.plot(edges, stats.norm.pdf(edges), "k", lw=1, label="normal")
    for part, name, colour in ((ratios[:, :3], "translations", "C0"), (ratios[:, 3:], "rotations", "C1")):
        values = np.sort(part.ravel())
        left.hist(np.clip(values, -5, 5), edges, density=True, histtype="step", color=colour, label=name)
        expected = stats.norm.ppf((np.arange(len(values)) + 0.5) / len(values))
        right.plot(expected, values, ".", ms=2.5, color=colour, label=name)
    right.plot([-4, 4], [-4, 4], "k", lw=1)
    left.set_xlabel("error / predicted sd")
    left.set_ylabel("density")
    right.set_xlabel("normal quantile")
    right.set_ylabel("error / predicted sd")
    left.legend(frameon=False)
    return image
