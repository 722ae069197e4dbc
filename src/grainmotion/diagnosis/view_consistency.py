"""How well the views of a scan agree with each other in a geometry: half of them against the other half.

The residual of half of the views in a reconstruction of the other half is 0.03-0.07 of the radiographs for a sound scan
of many views, and grows as the views get fewer, because half of them do not determine the sample.  What any sample
like this one gives with so few views is measured: the same residual of the radiographs of the reconstruction itself,
which are consistent by construction.  With r the residual and r₀ this one, the judged number is

    √max(0, r² − (c r₀)²)

with c from `CONSISTENT_SHARE`.  It tends to r for many views.  Figures in
`docs/decisions/0023-checks-of-the-reference-geometry.md`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from grainmotion._typing import Float
from grainmotion.calibration.corrections import corrected, step_of_a_pixel
from grainmotion.calibration.cross_validation import Trial
from grainmotion.model.geometry import Geometry
from grainmotion.model.scan import Scan
from grainmotion.model.volume import Volume
from grainmotion.preprocessing.binning import binned_geometry, binned_grid, binned_scan, sufficient_views
from grainmotion.projection.volumes import project
from grainmotion.reconstruction.fit import fitted_volume
from grainmotion.reconstruction.settings import ReconstructSettings

CONSISTENT_SHARE = 1.1
"""c: a reconstruction is smoother than the sample, so that its own radiographs contradict each other less."""
HALF_SWEEPS = 2
"""SART sweeps of the reconstruction of each half."""
COMPARED_SWEEPS, MANY_VIEWS = 1, 48
"""The same where geometries of so many views are compared view by view; of fewer, two sweeps.

With one sweep instead of two, geometries lay 0.85-1.2 times as many standard errors apart for 60 and 90 views (7
stones, 500 and 20,000 photons a pixel), 0.8-1.05 times for 24 and 36, where 5 are reached barely.
"""
FULL_SWEEPS = 4
"""SART sweeps of the reconstruction of all views."""

MAX_VIEWS_TO_CHOOSE_ROWS = 20
"""Views, at most, in which the rows that change most are looked for."""
CIRCLE_POINTS = 12
"""Points of a circle that stands for the sides of the sample."""


@dataclass(frozen=True)
class Consistency:
    """Agreement of the views with each other.

    Attributes
    ----------
    residual : float
        r, of half of the views against the other half, over the norm of the radiographs.
    attainable : float
        r₀, the same for the radiographs of a reconstruction; 0 if r is so low that it was not measured.
    by_view : (n,) float array
        Residual of each view over the root mean square of the radiographs' norms.
    by_row : (rows,) float array
        Likewise for each row of the panel, over the views.
    residuals : (n, rows, columns) float array
        Residual of each pixel of the binned views.
    """

    residual: float
    attainable: float
    by_view: Float
    by_row: Float
    residuals: Float

    @property
    def judged(self) -> float:
        """What is compared with ``[check] warn`` and ``stop``."""
        return float(np.sqrt(max(0.0, self.residual**2 - (CONSISTENT_SHARE * self.attainable) ** 2)))


@dataclass(frozen=True, eq=False)
class BinnedViews:
    """Binned radiographs of a scan, whose geometry may be changed.

    Attributes
    ----------
    scan : Scan
        Binned, in the nominal geometry.
    grid : Volume
    views : (n,) int array
        Their indices in the scan.
    factor : int
    rows : (int, int)
        First of the binned rows and the one after the last.
    """

    scan: Scan
    grid: Volume
    views: NDArray[np.int64]
    factor: int
    rows: tuple[int, int]

    @classmethod
    def of(cls, scan: Scan, grid: Volume, factor: int) -> BinnedViews:
        """Radiographs and voxels ``factor`` times as large, of no more views than they need."""
        height, columns = (n // factor for n in scan.geometry.shape)
        views = sufficient_views(len(scan), columns)
        return cls(binned_scan(scan, factor, views), binned_grid(grid, factor), views, factor, (0, height))

    @classmethod
    def of_rows(cls, scan: Scan, grid: Volume, factor: int, number: int) -> BinnedViews:
        """Likewise, of those ``number`` neighbouring rows that change most from view to view, and the layers seen."""
        height, columns = (n // factor for n in scan.geometry.shape)
        if height <= number:
            return cls.of(scan, grid, factor)
        views = sufficient_views(len(scan), columns)
        few = views[:: max(1, len(views) // MAX_VIEWS_TO_CHOOSE_ROWS)]
        change = binned_scan(scan, factor, few).line_integrals.var(axis=0, dtype=float).sum(axis=1)
        first = int(np.argmax(np.convolve(change, np.ones(number), "valid")))
        rows = (first, first + number)
        small = binned_scan(scan, factor, views, rows)
        return cls(small, _layers_seen(binned_grid(grid, factor), small.geometry), views, factor, rows)

    def geometry(self, full: Geometry, shift: float = 0.0) -> Geometry:
        """The binned views of a geometry of the whole scan, the panel shifted along u, in binned pixels."""
        return shifted(binned_geometry(full, self.factor, self.views, self.rows), shift)

    def half_residual(self, geometry: Geometry) -> float:
        """r in a geometry of the binned views."""
        return relative_norm(self._residual(self.scan.line_integrals, geometry), self.scan.line_integrals)

    def squares_by_view(self, geometry: Geometry, half: int) -> Float:
        """r² of each view that is not in a half, 0 or 1, to compare geometries; r² is the sum of both halves."""
        sweeps = COMPARED_SWEEPS if len(self.scan) >= MANY_VIEWS else HALF_SWEEPS
        r = self._trial(self.scan.line_integrals, geometry, sweeps).residual_outside(np.zeros(0), half)
        return (r**2).sum(axis=(1, 2)) / float((self.scan.line_integrals.astype(float) ** 2).sum())

    def squares_of_rows(self, geometry: Geometry, rows: slice, halves: tuple[int, ...]) -> Float:
        """r² of each view outside of halves, in some rows, over the square of the radiographs there."""
        trial = self._trial(self.scan.line_integrals, geometry, HALF_SWEEPS)
        r = np.concatenate([trial.residual_outside(np.zeros(0), half)[:, rows] for half in halves])
        return (r**2).sum(axis=(1, 2)) / float((self.scan.line_integrals[:, rows].astype(float) ** 2).sum())

    def consistency(self, geometry: Geometry, negligible: float = 0.0) -> Consistency:
        """r in a geometry of the binned views and, if r is not ``negligible``, r₀, which takes three times as long."""
        images = self.scan.line_integrals
        r = self._residual(images, geometry)
        residual = relative_norm(r, images)
        attainable = 0.0 if residual <= negligible else self._attainable(geometry)
        scale = np.linalg.norm(images) / np.sqrt(len(images))
        by_row = np.linalg.norm(r, axis=(0, 2)) / np.linalg.norm(images) * np.sqrt(r.shape[1])
        return Consistency(residual, attainable, np.linalg.norm(r, axis=(1, 2)) / scale, by_row, r)

    def _attainable(self, geometry: Geometry) -> float:
        """r₀ in a geometry of the binned views."""
        settings = ReconstructSettings(method="sart", sweeps=FULL_SWEEPS, tolerance=0, outline="grid")
        scan = Scan(self.scan.line_integrals, geometry, self.scan.valid)
        own = project(fitted_volume(scan, self.grid, settings).volume, geometry)
        return relative_norm(self._residual(own, geometry), own)

    def _residual(self, images: NDArray[np.floating], geometry: Geometry) -> Float:
        return self._trial(images, geometry, HALF_SWEEPS).residual(np.zeros(0)).reshape(images.shape)

    def _trial(self, images: NDArray[np.floating], geometry: Geometry, sweeps: int) -> Trial:
        return Trial(Scan(images, geometry, self.scan.valid), self.grid, (), np.zeros(0), sweeps)


def _layers_seen(grid: Volume, geometry: Geometry) -> Volume:
    """The layers of a grid whose upright cylinder projects onto the panel."""
    angles = np.linspace(0, 2 * np.pi, CIRCLE_POINTS, endpoint=False)
    circle = np.stack([np.cos(angles), np.sin(angles), np.zeros_like(angles)], axis=1)
    circle = circle * grid.voxel_size * min(grid.shape[1:]) / 2 + grid.center
    heights = (np.arange(grid.shape[0]) - (grid.shape[0] - 1) / 2) * grid.voxel_size
    points = (circle[None] + heights[:, None, None] * np.array([0.0, 0.0, 1.0])).reshape(-1, 3)
    rows = geometry.project_points(points)[..., 0].reshape(len(geometry), len(heights), -1)
    seen = np.flatnonzero(((rows > -1.5) & (rows < geometry.shape[0] + 0.5)).any(axis=(0, 2)))
    if not len(seen):
        return grid
    center = np.array(grid.center) + np.array([0.0, 0.0, heights[seen[[0, -1]]].mean()])
    return Volume.zeros((int(seen[-1] - seen[0] + 1), *grid.shape[1:]), grid.voxel_size, tuple(center.tolist()))


def shifted(geometry: Geometry, shift: float) -> Geometry:
    """Panels shifted along u by pixels."""
    return corrected(geometry, {"shift_u": shift * step_of_a_pixel("shift_u", geometry)}) if shift else geometry


def best_shift(residual: Callable[[float], float], shifts: Float, steps: tuple[float, ...]) -> float:
    """The shift of the lowest residual: of ``shifts``, then by descent in ``steps``."""
    values = {float(s): residual(float(s)) for s in shifts}
    best = min(values, key=values.__getitem__)
    for step in steps:
        for candidate in (best - step, best + step):
            if candidate not in values:
                values[candidate] = residual(candidate)
        best = min(values, key=values.__getitem__)
    return best


def relative_norm(part: NDArray[np.floating], whole: NDArray[np.floating]) -> float:
    """‖part‖/‖whole‖."""
    return float(np.linalg.norm(part) / max(float(np.linalg.norm(whole)), 1e-12))
