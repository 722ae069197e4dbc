"""Which geometry of a full scan is the right one: rough trials of many, and a fine comparison of two.

Rough trials bin the radiographs to some 20 columns, where one takes some hundredths of a second; each geometry is tried
with the panel shifted along u, so that an axis that is off is not taken for wrong angles.  They tell apart geometries
that differ by much.  A wrong sense of rotation, or a counted end point, differs by less than one of those pixels: the
fine comparison uses the finest pixels, but few rows, and a paired test, view by view.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from grainmotion._typing import Float, Index
from grainmotion.calibration.calibrate import SEARCH_RANGE
from grainmotion.diagnosis.hypotheses import HYPOTHESES, corrected
from grainmotion.diagnosis.view_consistency import BinnedViews, Consistency, best_shift
from grainmotion.model.geometry import Geometry
from grainmotion.model.progress import counted
from grainmotion.model.scan import Scan
from grainmotion.model.task_map import each
from grainmotion.model.volume import Volume
from grainmotion.preprocessing.binning import best_factor

ROUGH_STEP = 2
"""Step of the panel's shift in rough trials, pixels."""
JUDGED_STEPS = (1.0, 0.5, 0.25)
"""Steps of the search for the panel's shift from there, pixels of the judged residual."""
TIE_DECIMALS = 3
"""Of rough residuals; of hypotheses that are mirror images of each other the first in the list is taken."""
ROUGH_COLUMNS = (14, 24)
"""Columns of the radiographs in rough trials, least and most."""
JUDGED_COLUMNS = (20, 40)
"""Columns of the radiographs that give the judged residual."""
FINE_ROWS = 8
"""Rows of the fine comparison."""
FINE_COLUMNS = 400
"""Columns of the fine comparison, at most: a wider panel shows the same at its larger pixels."""
FINE_STEPS = (0.5, 0.25)
"""Steps of the search for the panel's shift in the fine comparison, pixels; only where two geometries are close."""
SIGNIFICANT_T = 5.0
"""A geometry is better from this many standard errors on: differences of the views' squared residuals, paired.

Sound scans of 24 views or more gave 8 to 42 for the sense of rotation in a cone beam, |t| < 2 in a parallel beam, where
nothing tells it; with 12 views |t| < 1.
"""
CLOSE_T = 3.0
"""Below it the shift of the panel is searched anew for both geometries."""


_Trial = tuple[Geometry, float, int]
"""A geometry of the whole scan, a shift of its panel, and the half of the views that are reconstructed."""


@dataclass(frozen=True)
class Tried:
    """A geometry that was tried.

    Attributes
    ----------
    fixes : tuple of str
        Hypotheses applied to the nominal geometry, in turn; empty for the nominal geometry.
    geometry : Geometry
        Of the whole scan.
    shift : float
        Best shift of the panel along u, pixels of the scan.
    consistency : Consistency
        Agreement of the views.
    """

    fixes: tuple[str, ...]
    geometry: Geometry
    shift: float
    consistency: Consistency


@dataclass(frozen=True)
class Comparison:
    """One geometry beside another, at the finest pixels.

    Attributes
    ----------
    residuals : (float, float)
        Of half of the views against the other half, in the first and in the second geometry.
    t : float
        Standard errors by which the second is worse; negative if it is better.
    """

    residuals: tuple[float, float]
    t: float

    @property
    def first_is_better(self) -> bool:
        """Whether the first geometry is significantly better."""
        return self.t > SIGNIFICANT_T

    @property
    def second_is_better(self) -> bool:
        """Whether the second geometry is significantly better."""
        return self.t < -SIGNIFICANT_T

    @property
    def undecided(self) -> bool:
        """Whether the data do not tell."""
        return abs(self.t) <= SIGNIFICANT_T


class Rivals:
    """Trials of geometries on one scan."""

    def __init__(self, scan: Scan, grid: Volume) -> None:
        self._scan = scan
        self._rough, self._judged = (
            BinnedViews.of(scan, grid, best_factor(scan, grid, columns)) for columns in (ROUGH_COLUMNS, JUDGED_COLUMNS)
        )
        fine = -(-scan.geometry.shape[1] // FINE_COLUMNS)
        self._fine = BinnedViews.of_rows(scan, grid, fine, FINE_ROWS)
        self._known_squares: dict[tuple[bytes, float, int], Float] = {}

    @property
    def nominal(self) -> Geometry:
        """The geometry as given."""
        return self._scan.geometry

    @property
    def judged_views(self) -> BinnedViews:
        """The binned views that are judged."""
        return self._judged

    @property
    def views(self) -> Index:
        """Indices of the views that are judged."""
        return self._judged.views

    def as_given(self, negligible: float = 0.0) -> Tried:
        """The nominal geometry, its panel where it is said to be; ``negligible`` as of `BinnedViews.consistency`."""
        return self._tried((), self.nominal, 0.0, negligible)

    def tried(self, fixes: tuple[str, ...], negligible: float = 0.0) -> Tried:
        """The nominal geometry with fixes, the panel shifted along u to where it fits best; else as `as_given`."""
        geometry, judged = corrected(self._scan.geometry, fixes), self._judged
        start = round(self._rough_shift(geometry)[1] * self._rough.factor / judged.factor)
        starts = np.array(sorted({0.0, float(start)}))
        shift = best_shift(lambda x: judged.half_residual(judged.geometry(geometry, x)), starts, JUDGED_STEPS)
        return self._tried(fixes, geometry, shift * judged.factor, negligible)

    def ranked(self, candidates: Iterable[tuple[str, ...]]) -> list[tuple[str, ...]]:
        """Those fixes that change the geometry, the best first, by rough trials."""
        seen, values = [self._scan.geometry.vectors], {}
        for fixes in counted(list(candidates)):
            geometry = corrected(self._scan.geometry, fixes)
            if not any(np.allclose(geometry.vectors, other) for other in seen):
                seen.append(geometry.vectors)
                values[fixes] = round(self._rough_shift(geometry)[0], TIE_DECIMALS)
        return sorted(values, key=values.__getitem__)

    def _rough_shift(self, geometry: Geometry) -> tuple[float, float]:
        """Lowest residual of rough trials of a geometry, and its shift of the panel along u, rough pixels."""
        rough = self._rough
        reach = int(SEARCH_RANGE * rough.scan.geometry.shape[1]) // ROUGH_STEP * ROUGH_STEP
        shifts = np.arange(-reach, reach + 1.0, ROUGH_STEP)
        values = each(rough.half_residual, [rough.geometry(geometry, float(x)) for x in shifts])
        return min(values), float(shifts[int(np.argmin(values))])

    def compare(self, first: Tried, second: Geometry) -> Comparison:
        """A geometry and another one at the finest pixels, few rows.

        One half of the views is compared first; if the first geometry is clearly better there, it is.
        """
        fine, pair = self._fine, (first.geometry, second)
        shifts = [first.shift / fine.factor] * 2
        comparison = self._compared(pair, shifts, (0,))
        if comparison.first_is_better:
            return comparison
        comparison = self._compared(pair, shifts)
        if comparison.t < CLOSE_T:
            for k, geometry in enumerate(pair):
                shifts[k] = best_shift(partial(self._misfit, geometry), np.array([shifts[k]]), FINE_STEPS)
            comparison = self._compared(pair, shifts)
        return comparison

    def compare_first_halves(self, first: Tried, others: Sequence[Geometry]) -> None:
        """Prepare `compare` of one geometry with each of others: their trials do not depend on each other."""
        self._try_squares([(g, first.shift / self._fine.factor, 0) for g in (first.geometry, *others)])

    def _compared(
        self, pair: tuple[Geometry, Geometry], shifts: list[float], halves: tuple[int, ...] = (0, 1)
    ) -> Comparison:
        trials = [[(g, x, half) for half in halves] for g, x in zip(pair, shifts, strict=True)]
        self._try_squares([trial for of_one in trials for trial in of_one])
        first, second = (np.concatenate([self._known_squares[_key(t)] for t in of_one]) for of_one in trials)
        difference = second - first
        error = float(difference.std()) / np.sqrt(len(difference))
        scale = 1e-9 * float(first.mean())
        return Comparison(
            (float(np.sqrt(first.sum())), float(np.sqrt(second.sum()))), float(difference.mean() / (error + scale))
        )

    def _misfit(self, geometry: Geometry, shift: float) -> float:
        """r² at the finest pixels."""
        trials = [(geometry, shift, half) for half in (0, 1)]
        self._try_squares(trials)
        return float(sum(self._known_squares[_key(trial)].sum() for trial in trials))

    def _try_squares(self, trials: Sequence[_Trial]) -> None:
        """r² of each view outside a half, finest pixels; that of the nominal geometry is needed for each comparison."""
        new = {_key(trial): trial for trial in trials if _key(trial) not in self._known_squares}
        self._known_squares.update(zip(new, each(partial(_squares, self._fine), list(new.values())), strict=True))

    def _tried(self, fixes: tuple[str, ...], geometry: Geometry, shift: float, negligible: float = 0.0) -> Tried:
        judged = self._judged
        consistency = judged.consistency(judged.geometry(geometry, shift / judged.factor), negligible)
        return Tried(fixes, geometry, shift, consistency)


def _key(trial: _Trial) -> tuple[bytes, float, int]:
    geometry, shift, half = trial
    return geometry.vectors.tobytes(), shift, half


def _squares(fine: BinnedViews, trial: _Trial) -> Float:
    geometry, shift, half = trial
    return fine.squares_by_view(fine.geometry(geometry, shift), half)


def singles() -> list[tuple[str, ...]]:
    """Each hypothesis alone."""
    return [(name,) for name in HYPOTHESES]
