"""How far each radiograph of a full scan is from its prediction by the half of the views to which it does not belong.

Where a radiograph and its prediction p differ by a shift s of the panel and a turn t about its centre,
r = -s·∇p - t (row ∂p/∂column - column ∂p/∂row), so that least squares give both for every view.  Some 40 columns and
as many views as these need show them to hundredths of a pixel (decision 0030), for a twentieth of a second.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np

from grainmotion._typing import Float, Index
from grainmotion.model.scan import Scan
from grainmotion.model.task_map import each
from grainmotion.model.view_shifts import ViewShifts
from grainmotion.model.volume import Volume
from grainmotion.preprocessing.binning import best_factor, binned_grid, binned_scan, sufficient_views
from grainmotion.projection.volumes import project
from grainmotion.reconstruction.fit import fitted_volume
from grainmotion.reconstruction.settings import ReconstructSettings

SHIFT_COLUMNS = (20, 40)
"""Columns of the binned radiographs, least and most."""
MIN_SHIFT_VIEWS, MIN_SHIFT_PIXELS = 12, 12
"""Views, and pixels along the shorter edge of the panel, below which nothing is measured."""
HALF_SWEEPS = 2
"""SART sweeps of the reconstruction of each half."""


def measured_shifts(scan: Scan, grid: Volume) -> ViewShifts | None:
    """Shifts of the views of a full scan of what is on a grid; None for one of few views or pixels, or an empty one."""
    rows, columns = scan.geometry.shape
    if len(scan) < MIN_SHIFT_VIEWS or min(rows, columns) < MIN_SHIFT_PIXELS or not scan.line_integrals.any():
        return None
    factor = best_factor(scan, grid, SHIFT_COLUMNS)
    views = sufficient_views(len(scan), columns // factor)
    small, coarse = binned_scan(scan, factor, views), binned_grid(grid, factor)
    residual = np.zeros(small.line_integrals.shape)
    for half, outside in enumerate(each(partial(_residual_outside, small, coarse), (0, 1))):
        residual[1 - half :: 2] = outside
    return view_shifts(small, residual, factor, views, grid.center)


def view_shifts(
    small: Scan, residual: Float, factor: int, views: Index, center: tuple[float, float, float]
) -> ViewShifts:
    """Shifts from the residuals of radiographs in predictions.

    Parameters
    ----------
    small : Scan
        The radiographs, of pixels ``factor`` times as large.
    residual : (n, rows, columns) array
        Radiographs minus predictions.
    factor : int
    views : (n,) int array
        Their numbers in the scan.
    center : (float, float, float)
        Centre of the sample, mm.
    """
    predicted, geometry = small.line_integrals - residual, small.geometry
    rows, columns = (np.arange(n) - (n - 1) / 2 for n in geometry.shape)
    down, right = (np.asarray(np.gradient(predicted, axis=axis)) for axis in (1, 2))
    valid = np.ones(residual.shape, bool) if small.valid is None else small.valid
    shifts, turns = np.zeros((len(residual), 2)), np.zeros(len(residual))
    for k, good in enumerate(valid):
        turning = rows[:, None] * right[k] - columns * down[k]
        images = right[k], down[k], predicted[k], np.ones_like(turning), turning
        parts = np.stack([image[good] for image in images], axis=1)
        # a view's own level and gain are no shift
        shifts[k] = -np.linalg.lstsq(parts[:, :4], residual[k][good], rcond=None)[0][:2]
        turns[k] = -np.linalg.lstsq(parts, residual[k][good], rcond=None)[0][4]
    along = geometry.u / np.linalg.norm(geometry.u, axis=1, keepdims=True)
    times = views / max(int(views[-1]), 1) - 0.5
    pixel, half_width = geometry.pixel_at(center) / factor, factor * geometry.shape[1] / 2
    return ViewShifts(factor * shifts, turns, views, times, along[:, :2], pixel, half_width)


def _residual_outside(small: Scan, grid: Volume, half: int) -> Float:
    """Residual of the views that are not in a half, 0 or 1, in its reconstruction."""
    inside, outside = slice(half, None, 2), slice(1 - half, None, 2)
    valid = None if small.valid is None else small.valid[inside]
    part = Scan(small.line_integrals[inside], small.geometry[inside], valid)
    settings = ReconstructSettings(method="sart", sweeps=HALF_SWEEPS, tolerance=0, outline="grid", device="cpu")
    volume = fitted_volume(part, replace(grid, field=None), settings).volume
    residual = small.line_integrals[outside].astype(float) - project(volume, small.geometry[outside])
    return residual if small.valid is None else np.where(small.valid[outside], residual, 0)
