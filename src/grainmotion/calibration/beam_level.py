"""Level of the beam in each view of a full scan: from air where there is some, else with the reconstruction.

The flats give the beam's intensity when they were taken.  If it differs in a view by the factor e^−δ, the line
integrals of that view are too large by δ, the same for all pixels.  Radiographs are binned to a few dozen columns, and
δ is estimated as unknowns of a small reconstruction (`reconstruction.view_offsets`).  With these δ the pixels that
show air, if there are any, are those that are as low as the lowest in nearly all views; their median gives δ more
exactly, and with its constant.  Thresholds and figures: decision 0026.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from grainmotion._typing import Float
from grainmotion.model.progress import counted
from grainmotion.model.scan import Scan
from grainmotion.model.volume import Volume
from grainmotion.preprocessing.binning import binned_grid, binned_images, binning_factor
from grainmotion.projection.volumes import project
from grainmotion.reconstruction.fit import fitted_volume
from grainmotion.reconstruction.settings import ReconstructSettings
from grainmotion.reconstruction.view_offsets import fitted_offsets

LevelSource = Literal["none", "air", "reconstruction"]

LEVEL_COLUMNS = 32
"""Columns to which the radiographs are binned."""
BLOCK_SAMPLES = 8
"""Pixels along each edge of a larger pixel that are averaged; more would only take time."""
MIN_LEVEL_VIEWS = 12
"""Fewer views do not determine a volume beside their levels."""
AIR_SHARE_OF_VIEWS = 0.95
"""Share of the views in which a pixel of air is low."""
AIR_TOLERANCE = 0.02
"""How far above the lowest pixel air may lie, over the range of the line integrals."""
MIN_AIR_SHARE = 0.02
"""Least share of the panel that is air.  Without air (panels inside a container or the sample) it was up to 0.019, with
two such panels of a cylinder's wall or liquid at 0.03 and 0.2, whose levels were right all the same."""
MAX_AIR_NOISE = 0.02
"""Largest scatter of air about the levels and its mean image, over the range of the line integrals: 0.001 to 0.008 of
air, 0.04 to 0.13 of pixels that sample or container cross in some views."""
MIN_LEVEL = 0.003
"""Least root mean square of the levels that is corrected.  Constant beams gave 0.0002 from air, and 0.0001 to 0.002
from the reconstruction, the largest under wrong angles; 0.006 to 0.019 where the sample is wider than the panel."""
MIN_LARGEST_LEVEL = 0.01
"""Least level of a single view that is corrected; constant beams gave 0.004 at most where the panel sees all."""
MAX_LEVELLED_MISFIT = 0.95
"""Largest misfit of a reconstruction of the levelled radiographs over that without levels.  Constant beams gave 0.963
to 1 (0.963 where the sample is three times as wide as the panel, which looks like a level in part), a beam that varies
by 5 % from view to view 0.09 to 0.91."""
SHORT_SWEEPS = 2
"""Sweeps of SART of these reconstructions."""
ZERO_SHARE = 0.25
"""Largest mean level of the first or last views over the median of all, by which the flats were taken with this beam
before or after the scan, so that levels count from zero.  What is above zero in all views alike may be a container that
fills the panel: subtracting it tripled the residual of the reconstruction."""
END_VIEWS = 3
"""Views at the beginning and at the end that are compared with the flats."""


@dataclass(frozen=True, eq=False)
class BeamLevels:
    """What to subtract from the line integrals of each view.

    Attributes
    ----------
    levels : (views,) array
        Line integral of the air in each view; zeros if the beam is constant.
    source : {"none", "air", "reconstruction"}
        Where they come from; "none" if there is nothing to correct.
    """

    levels: Float
    source: LevelSource = "none"

    @property
    def rms(self) -> float:
        """Root mean square of the levels."""
        return float(np.sqrt(np.mean(self.levels**2)))

    @property
    def largest(self) -> tuple[int, float]:
        """The view whose level is furthest from zero, and that level."""
        view = int(np.argmax(np.abs(self.levels)))
        return view, float(self.levels[view])


def beam_levels(scan: Scan, grid: Volume, settings: ReconstructSettings) -> BeamLevels:
    """Estimate the beam's level in each view of a full scan; zeros unless they are significant.

    Parameters
    ----------
    scan : Scan
        Line integrals of the full scan.
    grid : Volume
        Where the sample is; its values do not matter.
    settings : ReconstructSettings
        Projector and constraints of the volume.

    Returns
    -------
    BeamLevels
        To be subtracted, see `Scan.levelled`.
    """
    constant = BeamLevels(np.zeros(len(scan)))
    if len(scan) < MIN_LEVEL_VIEWS or not scan.line_integrals.any():
        return constant
    factor = binning_factor(scan.geometry.shape, LEVEL_COLUMNS)
    small, factor = _binned(scan, factor)
    coarse = binned_grid(grid, factor)
    offsets = fitted_offsets(small, coarse, settings)
    offsets -= np.median(offsets)
    air = _air(small, offsets)
    if air is not None:
        levels = BeamLevels(_air_levels(small, air, offsets), "air")
        return levels if _notable(levels) else constant
    levels = BeamLevels(offsets, "reconstruction")
    if not _notable(levels):
        return constant
    before, after = (_misfit(s, coarse, settings) for s in counted((small, small.levelled(offsets))))
    return levels if after < MAX_LEVELLED_MISFIT * before else constant


def _notable(levels: BeamLevels) -> bool:
    return levels.rms > MIN_LEVEL or abs(levels.largest[1]) > MIN_LARGEST_LEVEL


def _air_levels(scan: Scan, air: NDArray[np.bool_], offsets: Float) -> Float:
    """Levels of the air; about their median if it is not certain that these pixels show air.

    A container's wall in all of them gives the same small line integral in all views (0.007 in a hard case).
    """
    levels = scan.air_medians(air)
    unknown = np.isnan(levels)
    levels[unknown] = offsets[unknown] + np.nanmean(levels - offsets)
    middle = float(np.median(levels))
    ends = min(abs(levels[:END_VIEWS].mean()), abs(levels[-END_VIEWS:].mean()))
    near_zero = middle <= 0 or (middle <= MIN_LARGEST_LEVEL and levels.std() > MIN_LEVEL)
    return levels if near_zero or ends <= ZERO_SHARE * middle else levels - middle


def _misfit(scan: Scan, grid: Volume, settings: ReconstructSettings) -> float:
    """Norm of b − A x after a short reconstruction."""
    plain = replace(settings, method="sart", sweeps=SHORT_SWEEPS, tolerance=0, relaxation=None, decay=None, noise=None)
    plain = replace(plain, outline="grid")
    volume = fitted_volume(scan, grid, plain).volume
    difference = scan.line_integrals - project(volume, scan.geometry, projector=settings.projector)
    return float(np.linalg.norm(difference if scan.valid is None else np.where(scan.valid, difference, 0)))


def _air(scan: Scan, offsets: Float) -> NDArray[np.bool_] | None:
    """Pixels ``(rows, columns)`` that show air in nearly all views, if there are enough."""
    images = scan.line_integrals - offsets[:, None, None].astype(scan.line_integrals.dtype)
    low, high = np.quantile(images, (0.005, 0.995))
    highest = np.quantile(images, AIR_SHARE_OF_VIEWS, axis=0)
    air = highest < highest.min() + AIR_TOLERANCE * (high - low)
    if air.mean() < MIN_AIR_SHARE:
        return None
    values = images[:, air]
    scatter = values - np.median(values, axis=1, keepdims=True)
    scatter -= scatter.mean(axis=0)
    return air if scatter.std() < MAX_AIR_NOISE * (high - low) else None


def _binned(scan: Scan, factor: int) -> tuple[Scan, int]:
    """All views with pixels about ``factor`` times as large, each the mean of a few of its pixels; and the factor."""
    samples = min(factor, BLOCK_SAMPLES)
    stride = factor // samples
    factor = samples * stride
    rows, columns = ((n // factor) * factor for n in scan.geometry.shape)
    r0, c0 = (scan.geometry.shape[0] - rows) // 2, (scan.geometry.shape[1] - columns) // 2
    taken = (slice(r0 + stride // 2, r0 + rows, stride), slice(c0 + stride // 2, c0 + columns, stride))
    geometry = scan.geometry.window((r0, c0), (rows, columns)).binned(factor)
    images = scan.line_integrals[:, *taken]
    if scan.valid is None:
        return Scan(binned_images(images, samples), geometry), factor
    good = scan.valid[:, *taken]
    share = binned_images(good.astype(np.float32), samples)
    mean = binned_images(np.where(good, images, 0), samples) / np.maximum(share, 1e-6)
    return Scan(mean, geometry, share > 0), factor
