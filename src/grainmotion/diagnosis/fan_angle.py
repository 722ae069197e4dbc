"""Whether the rays of a full scan spread as the told distances say.

A common scale of all lengths leaves every radiograph as it is, but the angle between neighbouring rays does not:
it is pixel_size/source_to_detector.  With the source f times as far away and the pixel at the sample kept, half of the
views fit the other half best at the true f; a parabola through three residuals over log f finds it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from grainmotion._typing import Float
from grainmotion.diagnosis.rival_geometries import SIGNIFICANT_T, Tried
from grainmotion.diagnosis.view_consistency import BinnedViews
from grainmotion.model.finding import Check, Finding, Level
from grainmotion.model.geometry import Geometry
from grainmotion.model.scan import Scan
from grainmotion.model.task_map import each
from grainmotion.model.volume import Volume

FAN_CHECK: Check = "reference-geometry"
MIN_FAN_VIEWS = 24
"""Fewer views do not tell."""
FACTORS = (0.7, 1.0, 1.43)
"""Factors of the source's distance that are tried first."""
MORE_FACTORS = (0.35, 0.5, 2.0, 2.8)
"""Those that are tried beside them where the first three do not enclose 1."""
USUAL_FACTORS = (0.7, 1.25)
"""Estimated factors without a remark.

Sound scans gave 0.95 to 1.16 (hard cases, laboratory cases, 1000 photons a pixel), one in a cell 0.79;
distances wrong by 0.5, 1.2, 1.33 and 2 gave 0.52, 1.20, 1.39 and 2.08, the second and third with 4 and 6 standard
errors.
"""
SURE_FACTORS = (0.85, 1.15)
"""Factors, estimated from the views outside of one half, without a remark: the other half is not asked then."""
FAN_COLUMNS = 32
"""Columns of the radiographs, about."""
MIDDLE_SHARE = 0.4
"""Share of the rows that are the middle of the panel."""
MAX_EDGE = 0.1
"""Line integral at the sides of the panel, over the largest, from which nothing is told."""
CLEAR_SHARE = 0.975
"""Residual with the estimated factor over that as given up to which a factor of no usual mistake is a warning.

Else it is a note.  Stones and wrong distances gave 0.95 to 0.993.  Upright cubes in the right geometry gave 0.984, at a
factor of 1.6: a pixel that a flat face crosses edge-on measures less than the mean of its line integrals.
"""
LIKE_ANOTHER = 0.15
"""Difference of log f from that of a usual mistake up to which the mistake is named."""


def fan_findings(scan: Scan, grid: Volume, nominal: Tried, where: str, most: float = np.inf) -> tuple[Finding, ...]:
    """A finding if the views agree clearly better with a source that is nearer or farther than told.

    ``most`` is the largest residual with which they agree.
    """
    views = FanViews.of(scan, grid, nominal)
    if scan.geometry.beam != "cone" or len(views.binned.views) < MIN_FAN_VIEWS or views.edge > MAX_EDGE:
        return ()
    if SURE_FACTORS[0] < best_factor_of(views.squares(FACTORS, (0,))) < SURE_FACTORS[1]:
        return ()
    squares = views.squares(FACTORS)
    if USUAL_FACTORS[0] < best_factor_of(squares) < USUAL_FACTORS[1]:
        return ()
    squares.update(views.squares(MORE_FACTORS))
    factor = best_factor_of(squares)
    if USUAL_FACTORS[0] < factor < USUAL_FACTORS[1]:
        return ()
    best = views.squares((factor,))[factor]
    difference = best - squares[1.0]
    errors = float(difference.mean() / max(difference.std() / np.sqrt(len(difference)), 1e-12))
    if errors > -SIGNIFICANT_T or best.sum() > most**2:
        return ()
    told, then = float(np.sqrt(squares[1.0].sum())), float(np.sqrt(best.sum()))
    mistake = _usual_mistake(nominal.geometry, factor)
    fact = _fact(nominal.geometry, factor) + (f"; probably {mistake}" if mistake else "")
    evidence = f"residual of half of the views against the other half {told:.4f} as given, {then:.4f} then, "
    evidence += f"{-errors:.0f} standard errors"
    level = Level.WARNING if mistake or then < CLEAR_SHARE * told else Level.NOTE
    evidence += "" if level is Level.WARNING else "; flat faces of the grains can do as much"
    return (Finding(level, FAN_CHECK, f"{where}.geometry", fact, evidence,
                    "check source_to_detector (from the source, not from the axis) and pixel_size (after binning), and "
                    "source_to_axis with them: all lengths of the results depend on them"),)  # fmt: skip


@dataclass(frozen=True, eq=False)
class FanViews:
    """Binned radiographs on voxels of a pixel's size, in a volume as wide as the panel sees.

    Voxels or volumes of other sizes shift the estimate.
    """

    binned: BinnedViews
    geometry: Geometry  # of all views
    shift: float  # of the panel along u, binned pixels

    @classmethod
    def of(cls, scan: Scan, grid: Volume, nominal: Tried) -> FanViews:
        """The radiographs of a scan in a geometry that was judged."""
        factor = max(1, round(scan.geometry.shape[1] / FAN_COLUMNS))
        rows, columns = (n // factor * factor for n in scan.geometry.shape)
        seen = Volume.zeros((rows, columns, columns), scan.geometry.pixel_at(grid.center), (0.0, 0.0, grid.center[2]))
        binned = BinnedViews.of(scan, seen, factor)
        return cls(binned, nominal.geometry, nominal.shift / factor)

    @property
    def edge(self) -> float:
        """Line integral at the sides of the panel over the largest: of a sample that is wider than the panel."""
        images = self.binned.scan.line_integrals
        return float(np.median(images[:, :, [0, -1]]) / max(float(np.quantile(images, 0.99)), 1e-12))

    def squares(self, factors: Sequence[float], halves: tuple[int, ...] = (0, 1)) -> dict[float, Float]:
        """r² of each view outside of halves, in the middle rows, with the source each factor times as far away.

        Towards the edge of a cone, flat faces and long bodies contradict any circular scan.
        """
        trials = [(factor, half) for factor in factors for half in halves]
        found = dict(zip(trials, each(self._squares_outside, trials), strict=True))
        return {factor: np.concatenate([found[factor, half] for half in halves]) for factor in factors}

    def _squares_outside(self, trial: tuple[float, int]) -> Float:
        factor, half = trial
        rows = self.binned.scan.geometry.shape[0]
        cut = round((1 - MIDDLE_SHARE) / 2 * rows)
        geometry = self.binned.geometry(with_source_at(self.geometry, factor), self.shift)
        return self.binned.squares_of_rows(geometry, slice(cut, rows - cut), (half,))


def with_source_at(geometry: Geometry, factor: float) -> Geometry:
    """The source ``factor`` times as far from the axis, and pixels that are as large at the axis as before."""
    vectors = geometry.vectors.reshape(-1, 4, 3).copy()
    source, detector = vectors[:, 0], vectors[:, 1]
    there = source * factor
    before, after = (np.linalg.norm(detector - s, axis=1) / np.linalg.norm(s, axis=1) for s in (source, there))
    vectors[:, 0] = there
    vectors[:, 2:] *= (after / before)[:, None, None]
    return Geometry(vectors.reshape(-1, 12), geometry.shape, geometry.beam)


def best_factor_of(squares: dict[float, Float]) -> float:
    """Factor of the lowest sum of squares, by a parabola over log f through the lowest of them and two more."""
    factors = np.array(sorted(squares))
    values = np.array([squares[f].sum() for f in factors])
    k = int(np.clip(values.argmin(), 1, len(factors) - 2))
    curvature, slope, _ = np.polyfit(np.log(factors[k - 1 : k + 2]), values[k - 1 : k + 2], 2)
    if curvature <= 0:
        return float(factors[values.argmin()])
    return float(np.clip(np.exp(-slope / (2 * curvature)), factors[0], factors[-1]))


def _distances(geometry: Geometry) -> tuple[float, float]:
    """Of the source from the axis and from the detector, mm."""
    source, detector = geometry.source[0], geometry.detector[0]
    return float(np.linalg.norm(source)), float(np.linalg.norm(detector - source))


def _fact(geometry: Geometry, factor: float) -> str:
    """What is wrong with the distances."""
    pixels = _distances(geometry)[1] / float(np.linalg.norm(geometry.u[0]))
    wide = "narrower" if factor > 1 else "wider"
    return (
        f"the rays spread over a {wide} angle than the distances say: the views agree best if source_to_detector is "
        f"about {factor * pixels:.0f} pixels long, and it is told as {pixels:.0f}"
    )


def _usual_mistake(geometry: Geometry, factor: float) -> str:
    """Which mistake makes the distances wrong by the factor; "" if none that is usual."""
    to_axis, to_detector = _distances(geometry)
    mistakes: dict[float, str] = {
        1 + to_axis / to_detector: "source_to_detector is told as the distance from the axis to the detector",
        2.0: "pixel_size is told twice as large as it is, as of a panel binned 2 x 2",
        0.5: "pixel_size is told half as large as it is, as of a panel that is not binned",
    }
    like = {abs(float(np.log(factor / f))): mistake for f, mistake in mistakes.items()}
    return like[min(like)] if min(like) < LIKE_ANOTHER else ""
