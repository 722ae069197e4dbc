"""Single views of a state that cannot be right: without a sample, twice the same radiograph, or of something else."""

from __future__ import annotations

import itertools
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from grainmotion.diagnosis.coarse_likeness import Likeness
from grainmotion.diagnosis.hypotheses import stage_angles_deg
from grainmotion.diagnosis.state_hypotheses import Sweep, gain
from grainmotion.model.finding import Check, Finding, Level
from grainmotion.model.scan import Scan
from grainmotion.projection.volumes import project

STATE_CHECK: Check = "state-geometry"
MAX_BLANK_CONTRAST = 0.1
"""Contrast of a radiograph over that of the simulated one, up to which it shows no sample.  Radiographs of the hard
cases and of laboratory cases have 0.5 to 2, without beam or without sample at most 0.02."""
MIN_GOOD_VALID = 0.2
"""Share of valid pixels below which a radiograph is of no use."""
MAX_STRANGE_SHARE = 0.2
"""How far a view fits better as given than from other sides, over the median of the other views, up to which it is
called strange.  Good views of 15 grains or more have 0.29 at least; views of another angle, of another sample, repeated
or flipped have -0.36 to 0.25, 95 % of them below 0.2."""
MIN_OTHERS = 0.35
"""The same quantity of the other views, absolute, from which they are taken as right."""
MIN_OTHERS_FEW, FEW_GRAINS = 2.0, 12
"""The same for samples of fewer grains, where good views differ: others have up to 1.4 beside one that fits nowhere."""
MIN_GAIN_OF_ONE = 1.4
"""Gain of another side, or of flipped rows, over a view as given from which the view is called strange.  Good views of
twelve stones (12 seeds) and of the hard cases (3 seeds) have up to 0.5, 0.9 with near-spherical grains; one that is
flipped has 1.8 to 2.4."""
MIN_VIEWS_TO_COMPARE = 3
MIN_REPEATED_GAIN = 0.02
"""How much better one of two equal radiographs must fit for the views to differ: two views of one angle give 0."""


def blank_views(likeness: Likeness, scan: Scan) -> NDArray[np.bool_]:
    """Views that show no sample ``(n,)``: closed shutter, empty beam, or hardly a valid pixel."""
    expected = project(likeness.volume, likeness.geometry).std(axis=(1, 2))
    blank = likeness.plain.std(axis=(1, 2)) < MAX_BLANK_CONTRAST * np.maximum(expected, 1e-12)
    if scan.valid is not None:
        blank |= scan.valid.mean(axis=(1, 2)) < MIN_GOOD_VALID
    return np.asarray(blank)


def repeated_views(likeness: Likeness, scan: Scan) -> list[tuple[int, int]]:
    """Pairs of views whose radiographs are equal in every pixel though they should differ, the better one first."""
    images, pairs = scan.line_integrals, []
    for i, j in itertools.combinations(range(len(scan)), 2):
        if np.array_equal(images[i], images[j]):
            fits = likeness.best(likeness.measured[[i, j]], likeness.geometry[[i, j]])
            if abs(gain(float(fits[0]), float(fits[1]))) > MIN_REPEATED_GAIN:
                pairs.append((i, j) if fits[0] > fits[1] else (j, i))
    return pairs


@dataclass(frozen=True)
class StrangeView:
    """A view that does not belong to the others: its number, its likeness as given and the median of the others.

    ``angle_deg`` is the angle at which it fits as well as they do, if there is one; ``flipped`` says that it does so
    upside down.
    """

    view: int
    likeness: float
    others: float
    angle_deg: float | None
    flipped: bool


def strange_views(likeness: Likeness, sweep: Sweep, count: int) -> list[StrangeView]:
    """Views that fit the reference no better as given than from any other side, where the others do.

    So are those that fit clearly better from another side, or upside down.  ``count`` is the number of grains.
    """
    n = len(likeness.geometry)
    if n < MIN_VIEWS_TO_COMPARE:
        return []
    angles = stage_angles_deg(likeness.geometry)
    now, flipped = np.diagonal(sweep.at(angles)), np.diagonal(sweep.at(angles, flipped=True))
    best, usual = sweep.upright.max(axis=1), np.median(sweep.upright, axis=1)
    lead = np.array([gain(u, f) for u, f in zip(usual, now, strict=True)])
    found = []
    for k in range(n):
        others = np.delete(np.arange(n), k)
        reference = float(np.median(lead[others]))
        least = MIN_OTHERS_FEW if count < FEW_GRAINS else MIN_OTHERS
        lost = reference > least and lead[k] < MAX_STRANGE_SHARE * reference
        if lost or (reference > MIN_OTHERS and gain(now[k], max(best[k], flipped[k])) > MIN_GAIN_OF_ONE):
            upside_down = bool(flipped[k] > best[k] and gain(usual[k], flipped[k]) > reference / 2)
            elsewhere = not upside_down and gain(usual[k], best[k]) > reference / 2
            angle = float(sweep.angles_deg[int(sweep.upright[k].argmax())]) if elsewhere else None
            found.append(StrangeView(k, float(now[k]), float(np.median(now[others])), angle, upside_down))
    return found if len(found) <= (n - 1) // 2 else []


@dataclass(frozen=True)
class ViewNames:
    """Words for views in findings: their state, their numbers as given, and the names of their radiographs."""

    where: str
    names: tuple[str, ...] = ()

    def __call__(self, view: int) -> str:
        """A view, by its number and the name of its radiograph."""
        return f"view {view} ({self.names[view]})" if view < len(self.names) else f"view {view}"

    def without(self, views: Iterable[int], count: int) -> str:
        """How to leave out views."""
        rest = [k for k in range(count) if k not in set(views)]
        return f"check that radiograph, or leave the view out: views = {rest} in the state's table"

    def finding(self, level: Level, fact: str, evidence: str, remedy: str, fix: str = "") -> Finding:
        """A finding on the state."""
        return Finding(level, STATE_CHECK, self.where, fact, evidence, remedy, fix)

    def blank(self, views: list[int], count: int) -> list[Finding]:
        """Findings on views without a sample."""
        if len(views) == count:
            remedy = "check radiographs, flats and darks of this state"
            return [self.finding(Level.ERROR, "no radiograph shows the sample: all are blank", "", remedy)]
        text = "{} shows no sample: it is blank (closed shutter, no beam, or an empty stage)"
        remedy = self.without(views, count)
        return [self.finding(Level.ERROR, text.format(self(k)), "", remedy) for k in views]

    def repeated(self, pairs: list[tuple[int, int]], count: int) -> list[Finding]:
        """Findings on radiographs that are there twice."""
        return [
            self.finding(
                Level.ERROR, f"{self(j)} and {self(i)} are the same radiograph, but have different angles",
                "they are equal in every pixel", self.without([j], count),
            )
            for i, j in pairs
        ]  # fmt: skip
