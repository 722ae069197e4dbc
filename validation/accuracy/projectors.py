"""Projectors: errors with each choice of the model of grains."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Literal

from grainmotion.model.grains import GrainSet
from grainmotion.segmentation.extraction import grains_from_labels
from grainmotion.segmentation.segment import segment
from grainmotion.tracking.track import TrackSettings
from validation.accuracy import limits, page, specimens
from validation.accuracy.limits import Limited, over_bounds
from validation.accuracy.outcomes import Outcome, measure, pool
from validation.accuracy.specimens import Specimen
from validation.common.cache import TRACKING
from validation.common.trials import run_trials
from validation.paper import gravel

STATE = "random"
VIEWS = (4, 2)
SEEDS = {"small": (0, 1, 2), "paper": (0,)}
STAGES = TrackSettings().filters[:-1]


@dataclass(frozen=True)
class Variant:
    """One model of the grains, and how it is fitted.

    Attributes
    ----------
    name : str
    reference : {"SART", "Siddon", "exact"}
        Where attenuation comes from: SART by the default projector or by the exact path, or the true sample.
    labels : {"segmented", "exact"}
    finer : int
        Of `grains_from_labels`.
    settings : TrackSettings
    scales : tuple of str
        On which it is tried.
    """

    name: str
    reference: Literal["SART", "Siddon", "exact"] = "SART"
    labels: Literal["segmented", "exact"] = "segmented"
    finer: int = 2
    settings: TrackSettings = field(default_factory=TrackSettings)
    scales: tuple[str, ...] = ("small", "paper")


VARIANTS = (
    Variant("default: trilinear on voxels 2 times finer, filter 0.7"),
    Variant("exact path (Siddon's) in SART and tracking", "Siddon", settings=TrackSettings(projector="exact")),
    Variant("trilinear on the reference's voxels", finer=1),
    Variant("voxels 3 times finer", finer=3, scales=("small",)),
    Variant("exact labels", labels="exact"),
    Variant("exact labels, reference's voxels", labels="exact", finer=1),
    Variant("exact labels and attenuation", "exact", "exact"),
    Variant("exact labels and attenuation, reference's voxels", "exact", "exact", finer=1),
    Variant("last filter 0 pixels", settings=TrackSettings(filters=(*STAGES, 0.0))),
    Variant("last filter 0.99 pixels", settings=TrackSettings(filters=(*STAGES, 0.99))),
    Variant("weights of photons", settings=TrackSettings(weights="photons")),
    Variant("weights of photons, Poisson's likelihood", settings=TrackSettings(weights="photons", loss="poisson")),
    Variant("Huber's loss", settings=TrackSettings(loss="huber")),
)


@dataclass(frozen=True)
class Trial:
    """One specimen, and the variants to try on it."""

    specimen: Specimen
    variants: tuple[Variant, ...] = VARIANTS


def trial(job: Trial) -> dict[tuple[str, int], Limited]:
    """The outcomes and bounds, by the variant's name and views."""
    return {(v.name, views): state(job.specimen, v, views) for v in job.variants for views in VIEWS}


def state(specimen: Specimen, variant: Variant, views: int) -> Limited:
    """One state, tracked by one variant, and its bounds."""
    return Limited(tracked(specimen, variant, views), specimens.bounds(specimen, STATE, views))


@page.PAGE.cached(*TRACKING)
def tracked(specimen: Specimen, variant: Variant, views: int) -> Outcome:
    """One state, tracked by one variant."""
    case = specimens.case(specimen)
    scan = specimens.state(specimen, STATE, views)
    sample = model(specimen, variant)
    return measure(sample, scan, case.motions[STATE], case.scanner.voxel_size, variant.settings)


def model(specimen: Specimen, variant: Variant) -> GrainSet:
    """The grains as a variant models them."""
    if variant.reference == "exact":
        volume = specimens.true_volume(specimen)
    else:
        volume = specimens.volume(specimen, gravel.SIDDON if variant.reference == "Siddon" else gravel.SMOOTH)
    labels = specimens.true_labels(specimen) if variant.labels == "exact" else segment(volume).labels
    return grains_from_labels(volume, labels, finer=variant.finer)


def study() -> page.Section:
    """All variants on both scales."""
    jobs = [
        Trial(Specimen(scale, seed), tuple(v for v in VARIANTS if scale in v.scales))
        for scale, seeds in SEEDS.items()
        for seed in seeds
    ]
    done = dict(zip(jobs, run_trials(trial, jobs, page.PROCESSES), strict=True))
    return section({scale: [found for job, found in done.items() if job.specimen.scale == scale] for scale in SEEDS})


def section(found: dict[str, list[dict[tuple[str, int], Limited]]]) -> page.Section:
    """A table a scale."""
    head = [
        "model",
        *(f"{x}, {views} views" for views in VIEWS for x in ("u / bound", "ω / bound", "failures", "CPU s")),
    ]
    parts = []
    for scale, trials in found.items():
        rows = [[name, *cells(name, trials)] for name in dict.fromkeys(name for name, _ in trials[0])]
        packings = f"{len(trials)} packing{'s' if len(trials) > 1 else ''}"
        parts.append(f"### {limits.NAMES[scale]}, {packings}\n\n{page.table(head, rows)}")
    text = f"""The state *{STATE}* (up to 5 voxels and 10°), SNR 50, tracked from a zero start by default but for what
is named.  Errors are root mean square over converged grains and components, over the Cramér–Rao bound of the same
grains; CPU seconds are of tracking one state.  *Exact labels* are of voxel centres in the true sample; *exact
attenuation* is the true sample averaged over each voxel, without reconstruction.  Filters are on pixels, whatever the
size of the grains.

{chr(10).join(parts)}"""
    return page.Section("Effect of the model of the grains", text, "; ".join(_headline(found)))


def cells(name: str, trials: list[dict[tuple[str, int], Limited]]) -> list[str]:
    """Errors over bounds, failures and CPU seconds, for a table."""
    row = []
    for views in VIEWS:
        some = [t[name, views] for t in trials]
        together = pool([x.outcome for x in some])
        u, rotation = over_bounds(some)
        row += [f"{u:.2f}", f"{rotation:.2f}", f"{together.failures}/{len(together.ok)}", f"{together.cpu:.1f}"]
    return row


def _headline(found: dict[str, list[dict[tuple[str, int], Limited]]]) -> Iterator[str]:
    names = [v.name for v in VARIANTS[:3]]
    for scale, trials in found.items():
        u, exact, one = (over_bounds([t[name, VIEWS[0]] for t in trials])[0] for name in names)
        yield f"u over the bound, {limits.NAMES[scale]}: {u:.1f}, reference's voxels {one:.1f}, exact path {exact:.1f}"
