"""Scores of laboratory samples: the library's default chain on one of them, held against its truth and its bar."""

from __future__ import annotations

import re
import time
from collections import Counter
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment
from scipy.spatial.distance import cdist

from grainmotion.analysis.validation import compare
from grainmotion.calibration.calibrate import calibrate
from grainmotion.model.grains import GrainSet
from grainmotion.model.motions import Motions, Status
from grainmotion.model.scan import Scan
from grainmotion.model.volume import Volume
from grainmotion.reconstruction.reconstruct import reconstruct
from grainmotion.segmentation.extraction import grains_from_labels
from grainmotion.segmentation.segment import segment
from grainmotion.simulate import LATER_ANGLES_DEG, HardCase
from grainmotion.tracking.track import TrackSettings, track
from validation.accuracy.specimens import in_voxels_and_degrees
from validation.common.measures import rms

Float = NDArray[np.float64]
MAX_OFFSET = 3.0
"""A measured grain whose centre is farther from every true one than so many voxels is no true grain."""
LIE_SDS, LIE_VOXELS, LIE_DEG = 5.0, 0.1, 2.0
"""A motion told as good is a lie if a component is off by so many standard deviations, and voxels or degrees."""
COVERED_SDS = 1.96
MIN_COVERAGE = 0.92
"""Least share of errors within 1.96 standard deviations, over many seeds (95 % if they are normal)."""


@dataclass(frozen=True)
class Bar:
    """What must hold of a case.

    Attributes
    ----------
    voxels, degrees : float
        Largest rms error of a component over the grains whose translation, or rotation, is told as good; for two
        materials over the dense ones.
    converged : {"all", "whole", "translations", "any"}
        Which of the grains that are there must converge: all, those that are whole on the panel, all but for their
        rotations, or none needs to.
    coverage : float
        Least share of errors within 1.96 standard deviations.
    note : str
        Pattern of a note on the state that must be there.
    """

    voxels: float = np.inf
    degrees: float = np.inf
    converged: Literal["all", "whole", "translations", "any"] = "all"
    coverage: float = MIN_COVERAGE
    note: str = ""

    def __str__(self) -> str:
        words = {"all": "all converged", "whole": "whole ones converged", "translations": "all translations good"}
        who = words.get(self.converged, "no lie")
        errors = [f"{x:g}{unit}" for x, unit in ((self.voxels, " voxel"), (self.degrees, "°")) if np.isfinite(x)]
        return ", ".join([who, *errors])


BARS = {
    "plain": Bar(0.01, 0.11),
    "tall": Bar(0.015, 0.15, "whole"),
    "wide": Bar(0.05, 0.5, "whole"),
    "platens": Bar(0.012, 0.12),
    "wet": Bar(0.02, 0.2),
    "drains": Bar(0.03, 0.3),
    "sizes": Bar(converged="whole"),
    "gone": Bar(0.02, 0.2),
    "soft": Bar(converged="any", coverage=0.0),
    "settling": Bar(coverage=0.9, note="moved|crept|sank|settl"),
    "materials": Bar(0.02),
    "combined": Bar(0.015, 0.1),
    "round": Bar(0.02, converged="translations"),
}
"""Goals with default settings, by the name of the case."""


@dataclass(frozen=True, eq=False)
class Score:
    """One state of one sample.

    Attributes
    ----------
    found, present, whole : int
        Grains measured; grains that are there; and those of them that are whole on the panel in both states.
    statuses : dict of str to int
        Of the measured grains.
    rows : (m,) int array
        Grains whose translation or rotation is told as good (`Motions.ok_translation`), as rows of the truth.
    errors, sds : (m, 6) arrays
        Their errors, and the standard deviations stated: voxels and degrees; NaN for what is not told as good.
    counted : (m,) bool array
        Whose errors the bar is for.
    wanted : int
        Grains that must converge, and do not.
    absent : (int, int)
        Missing grains called absent, and all missing ones.
    lies : list of str
        Grains whose motion is told as good and wrong by far, or that are missing, or no grain.
    notes : list of str
    cpu : float
        CPU seconds of the whole chain.
    error : str
        The exception, if there was one.
    """

    found: int = 0
    present: int = 0
    whole: int = 0
    statuses: dict[str, int] = field(default_factory=dict)
    rows: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))
    errors: Float = field(default_factory=lambda: np.zeros((0, 6)))
    sds: Float = field(default_factory=lambda: np.zeros((0, 6)))
    counted: NDArray[np.bool_] = field(default_factory=lambda: np.zeros(0, bool))
    wanted: int = 0
    absent: tuple[int, int] = (0, 0)
    lies: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    cpu: float = 0.0
    error: str = ""


def score(case: HardCase, motions: Motions, views: int) -> Score:
    """Hold the measured motions of a state of ``views`` views against the truth."""
    h, truth = case.case.scanner.voxel_size, case.motions
    whole = case.whole(LATER_ANGLES_DEG[views])
    here = ~np.isin(truth.labels, case.missing)
    pairs = _paired(motions, truth, MAX_OFFSET * h)
    errors = np.full((len(truth), 6), np.nan)
    comparison = compare(motions, truth, h)
    sds = in_voxels_and_degrees(np.sqrt(np.diagonal(motions.covariances, axis1=1, axis2=2)), h)
    same = (pairs >= 0) & (comparison.matches == pairs)
    errors[same] = np.hstack([comparison.translation_errors / h, comparison.rotation_errors_deg])[same]
    good = np.repeat(np.stack([motions.ok_translation, motions.ok_rotation], axis=1), 3, axis=1)[pairs]
    errors[~(good & (same & here)[:, None])] = np.nan
    rows = np.flatnonzero(np.isfinite(errors).any(axis=1))
    rule = BARS[case.name].converged
    ok = np.isfinite(errors[:, : 3 if rule == "translations" else 6]).all(axis=1)
    must = here & (whole if rule == "whole" else rule != "any")
    gone = np.isin(np.arange(len(truth)), [label - 1 for label in case.missing]) & (pairs >= 0)
    called = int((motions.statuses[pairs[gone]] == Status.ABSENT.value).sum())
    values = np.array([p.attenuation for p in case.case.sample.particles])
    return Score(
        found=len(motions),
        present=int(here.sum()),
        whole=int((here & whole).sum()),
        statuses=dict(Counter(str(s) for s in motions.statuses)),
        rows=rows,
        errors=errors[rows],
        sds=sds[pairs[rows]],
        counted=(values > 0.5 * values.max())[rows],
        wanted=int((must & ~ok).sum()),
        absent=(called, len(case.missing)),
        lies=_lies(errors, sds, pairs, motions),
        notes=list(motions.fit.notes),
    )


def _lies(errors: Float, sds: Float, pairs: NDArray[np.int64], motions: Motions) -> list[str]:
    """Sentences on motions told as good that are wrong by far, or of no grain that is there."""
    out = []
    least = np.repeat([LIE_VOXELS, LIE_DEG], 3)
    told = np.isfinite(errors).any(axis=1)
    for row in np.flatnonzero(told):
        own = np.nan_to_num(np.abs(errors[row]))
        if (own > np.maximum(LIE_SDS * sds[pairs[row]], least)).any():
            out.append(f"grain {row + 1}: {own[:3].max():.2f} voxel, {own[3:].max():.1f}°")
    for k in np.flatnonzero(motions.ok & ~np.isin(np.arange(len(motions)), pairs[told])):
        gone = np.flatnonzero(pairs == k)
        out.append(f"grain {gone[0] + 1} is missing" if len(gone) else f"label {motions.labels[k]} is no grain")
    return out


def _paired(measured: Motions, truth: Motions, largest: float) -> NDArray[np.int64]:
    """Row of ``measured`` of each true grain within ``largest``, −1 for none ``(n,)``."""
    matches = np.full(len(truth), -1)
    if len(measured):
        distances = cdist(truth.centers, measured.centers)
        rows, columns = linear_sum_assignment(np.minimum(distances, 3 * largest))
        near = distances[rows, columns] <= largest
        matches[rows[near]] = columns[near]
    return matches


# ---------------------------------------------------------------------- the default chain
def timed_reference(case: HardCase) -> tuple[GrainSet, float]:
    """The grains of the reference by default settings, and the CPU seconds that they and `calibrate` took."""
    scan, grid = case.reference(), case.case.scanner.grid
    begin = time.process_time()
    calibrate(scan, grid)  # its corrections are not used: the nominal geometry is the true one
    return reference_grains(scan, grid), time.process_time() - begin


def reference_grains(scan: Scan, grid: Volume) -> GrainSet:
    """The grains of a full scan by default settings."""
    volume = reconstruct(scan, grid).volume
    segmentation = segment(volume)
    return grains_from_labels(volume, segmentation.labels, border=segmentation.border)


def tracked(case: HardCase, grains: GrainSet, views: int, settings: TrackSettings | None = None) -> Score:
    """The score of the later state, tracked from a zero start."""
    scan = case.state(LATER_ANGLES_DEG[views])
    begin = time.process_time()
    motions = track(grains, scan, settings=settings)
    seconds = time.process_time() - begin
    return replace(score(case, motions, views), cpu=seconds)


# ---------------------------------------------------------------------- several seeds together
def shortfalls(bar: Bar, some: list[Score]) -> list[str]:
    """What the scores of a case lack of its bar; empty if it is met."""
    lacks = [f"{n} of {len(some)} runs failed"] if (n := sum(bool(s.error) for s in some)) else []
    if wanted := sum(s.wanted for s in some):
        lacks.append(f"{wanted} not converged")
    if bar.converged == "all" and (more := sum(max(s.found - s.present - s.absent[1], 0) for s in some)):
        lacks.append(f"{more} spurious")
    errors, sds, counted = together(some)
    u, w = rms_of_good(errors[counted][:, :3]), rms_of_good(errors[counted][:, 3:])
    lacks += [f"{u:.3f} voxel"] * bool(u > bar.voxels) + [f"{w:.2f}°"] * bool(w > bar.degrees)
    if np.isfinite(errors).any() and (share := coverage(errors, sds)) < bar.coverage:
        lacks.append(f"coverage {share:.0%}")
    if lies := sum(len(s.lies) for s in some):
        lacks.append(f"{lies} lies")
    if bar.note and not all(re.search(bar.note, " ".join(s.notes)) for s in some):
        lacks.append("no note")
    right, gone = (sum(s.absent[k] for s in some) for k in (0, 1))
    if right < gone:
        lacks.append(f"{gone - right} missing ones not absent")
    return lacks


def together(some: list[Score]) -> tuple[Float, Float, NDArray[np.bool_]]:
    """Errors, standard deviations, and whether the bar is for them, of the converged grains of some scores."""
    return (
        np.concatenate([s.errors for s in some]),
        np.concatenate([s.sds for s in some]),
        np.concatenate([s.counted for s in some]),
    )


def coverage(errors: Float, sds: Float) -> float:
    """Share of errors within 1.96 standard deviations, of those that are no NaN."""
    good = np.isfinite(errors)
    return float(np.mean((np.abs(errors) < COVERED_SDS * sds)[good]))


def rms_of_good(values: Float) -> float:
    """Root mean square of the values that are no NaN; NaN if all are."""
    return rms(values[np.isfinite(values)])
