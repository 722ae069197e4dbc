"""Beam hardening that a full scan shows by itself: only linearised radiographs are those of one volume.

Radiographs of a monochromatic beam are line integrals of one volume.  In a polychromatic beam long paths look too
short, and the views contradict each other.  A reconstruction is nearly linear in its radiographs, and so is
what it leaves of them, r(b).  If attenuation is gamma distributed over the spectrum, with θ its variance over its
squared mean, the line integral of the unhardened beam is

    g(b) = (e^{θ b} − 1)/θ = b + θ b²/2 + θ² b³/6 + …,

and θ minimises ‖r(g(b))‖², by Gauss–Newton with the derivative r(∂g/∂θ).  That is the consistency of the data, as in
Abdurahman et al. (IEEE Trans. Med. Imaging 37, 2018, 2266), with a reconstruction as its condition.  No template of the
sample is needed, so walls, liquids and grains of several materials do no harm.  Radiographs are binned and residuals
are smoothed: surfaces, which coarse voxels represent badly, leave residuals of a pixel, hardening leaves wide ones.
Figures: decision 0040.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from math import factorial

import numpy as np
from scipy.ndimage import gaussian_filter

from grainmotion._typing import Float, Image, Index
from grainmotion.model.geometry import Geometry
from grainmotion.model.hardening import LINEAR, Hardening
from grainmotion.model.progress import counted
from grainmotion.model.scan import Scan
from grainmotion.model.task_map import each
from grainmotion.model.volume import Volume
from grainmotion.preprocessing.binning import binned_grid, binned_scan, binning_factor, sufficient_views
from grainmotion.projection.volumes import project
from grainmotion.reconstruction.iterate import new_iterate
from grainmotion.reconstruction.ordered_subsets import plain_sart
from grainmotion.reconstruction.settings import ReconstructSettings

BINNED_COLUMNS, MIN_BINNING = 64, 2
"""Columns to which radiographs are binned at most; pixels that are binned at least, or it would cost as much as the
reconstruction itself."""
RESIDUAL_SMOOTHING = 4.0
"""Standard deviation of the Gaussian that residuals are smoothed with, binned pixels."""
SHORT_SWEEPS = 2
"""Sweeps of SART of these reconstructions; 3 gave the same curves."""
MAX_CURVE_STEPS, LAST_CURVE_CHANGE = 4, 0.02
"""Most Gauss-Newton steps; relative change of θ that ends them."""
CURVE_DEGREE = 5
"""Of the polynomial that stands for g."""
MIN_VIEWS = 24
"""Views from which the curve is estimated; so few still gave it right."""
VIEWS_AT_ONCE = 16
"""Views that are read and binned together."""
JACKKNIFE_GROUPS = 8
"""Groups of views that are left out in turn, for the standard deviation of the curve."""
MIN_DEPARTURE, MIN_DEPARTURE_SD, MIN_EXPLAINED_BY_CURVE = 0.02, 5.0, 0.1
"""Smallest departure of the longest path from linear, smallest one over its standard deviation, and smallest share of
the squared smoothed residual that it explains, from which radiographs are linearised.  Four energies gave 0.11 to 0.27
and 0.4 to 0.9 (beside wall, blur, inclusions and noise); all else, wrong geometry included, at most 0.008 and 0.02, or
a departure below zero, which no beam has."""
MIN_PANEL = 24
"""Pixels, and voxels, along the shortest edge of panel and grid from which a scan shows a curve."""
LIT_SHARE, LONGEST_PERCENTILE = 0.05, 99.5
"""Share of the largest line integral from which a pixel shows the sample; percentile for the longest path."""

ReadViews = Callable[[Index], Scan]
"""Reads some views of a scan; workers that share the run get it pickled."""


def consistent_hardening(
    views: ReadViews, geometry: Geometry, grid: Volume, settings: ReconstructSettings
) -> Hardening:
    """The curve by which radiographs contradict each other least; the identity unless it is significant.

    Parameters
    ----------
    views : callable
        Gives the scan of some views.
    geometry : Geometry
        Of all views.
    grid : Volume
        Where the scan is to be reconstructed, large enough to hold all rays; its values do not matter.
    settings : ReconstructSettings
        Projector, outline and device.

    Returns
    -------
    Hardening
        To be applied to the scan before it is reconstructed, and to those of the states.
    """
    small = len(geometry) < MIN_VIEWS or min(*geometry.shape, *grid.shape) < MIN_PANEL
    if settings.hardening != "auto" or small:
        return LINEAR
    problem = _Problem.of(views, geometry, grid, settings)
    theta = change = 0.0
    moments = np.ones((JACKKNIFE_GROUPS, 3))
    for step in counted(range(MAX_CURVE_STEPS)):
        residual, derivative = each(problem.residual, [_curve(theta), _derivative(theta)])
        groups = [slice(k, None, JACKKNIFE_GROUPS) for k in range(JACKKNIFE_GROUPS)]
        moments = np.array([_moments(residual[group], derivative[group]) for group in groups])
        squares, product, slopes = moments.sum(axis=0)
        if step == 0 and (product >= 0 or product**2 < MIN_EXPLAINED_BY_CURVE * squares * slopes):
            return LINEAR
        change = -float(product / slopes)
        theta += change
        if theta <= 0 or abs(change) < LAST_CURVE_CHANGE * theta:
            break
    if theta <= 0:
        return LINEAR
    _, product, slopes = (moments.sum(axis=0) - moments).T  # without each group
    sd = float(np.sqrt((JACKKNIFE_GROUPS - 1) * np.var(product / slopes))) * problem.longest / 2
    found = Hardening(_curve(theta), problem.longest, sd)
    return found if found.departure > max(MIN_DEPARTURE, MIN_DEPARTURE_SD * sd) else LINEAR


@dataclass(frozen=True, eq=False)
class _Problem:
    """Binned powers of the line integrals ``(degree, views, rows, columns)``, and where to reconstruct them."""

    powers: Image
    scan: Scan
    grid: Volume
    settings: ReconstructSettings
    longest: float

    @classmethod
    def of(cls, views: ReadViews, geometry: Geometry, grid: Volume, settings: ReconstructSettings) -> _Problem:
        """Read and bin as many views as so few columns need."""
        factor = max(MIN_BINNING, binning_factor(geometry.shape, BINNED_COLUMNS))
        chosen = sufficient_views(len(geometry), geometry.shape[1] // factor)
        groups = np.array_split(chosen, -(-len(chosen) // VIEWS_AT_ONCE))
        parts = each(partial(_binned_powers_of, views, factor), groups)
        scans = [scan for _, scan in parts]
        first, masks = scans[0].geometry, [scan.valid for scan in scans]
        geometry = Geometry(np.concatenate([scan.geometry.vectors for scan in scans]), first.shape, first.beam)
        valid = None if any(mask is None for mask in masks) else np.concatenate([m for m in masks if m is not None])
        powers = np.concatenate([images for images, _ in parts], axis=1)
        shown = powers[0] > LIT_SHARE * powers[0].max()
        longest = float(np.percentile(powers[0][shown], LONGEST_PERCENTILE)) if shown.any() else 0.0
        plain = replace(settings, method="sart", sweeps=SHORT_SWEEPS, tolerance=0, noise=None, non_negative=False)
        plain = replace(plain, relaxation=None, decay=None)
        return cls(powers, Scan(powers[0], geometry, valid), binned_grid(grid, factor), plain, longest)

    def residual(self, coefficients: Sequence[float]) -> Float:
        """Smoothed residual of the reconstruction of Σ c_k bᵏ, ``(views, rows, columns)``."""
        images = np.tensordot(np.array(coefficients, np.float32), self.powers, axes=1)
        iterate = new_iterate(replace(self.scan, line_integrals=images), self.grid, self.settings)
        plain_sart(iterate, len(images), self.settings, None)
        left = images - project(iterate.volume(), self.scan.geometry, projector=self.settings.projector)
        if self.scan.valid is not None:
            left = np.where(self.scan.valid, left, 0)
        return np.asarray(gaussian_filter(left.astype(float), (0, RESIDUAL_SMOOTHING, RESIDUAL_SMOOTHING)))


def _binned_powers_of(read: ReadViews, factor: int, some: Index) -> tuple[Image, Scan]:
    """Means over larger pixels of b, b², …, bⁿ; powers of negative values, which are noise, count as zero."""
    scan = read(some)
    views, b = np.arange(len(scan)), np.maximum(scan.line_integrals, 0)
    first = binned_scan(scan, factor, views)
    higher = [binned_scan(replace(scan, line_integrals=b**k), factor, views) for k in range(2, CURVE_DEGREE + 1)]
    return np.stack([s.line_integrals.astype(np.float32) for s in (first, *higher)]), first


def _curve(theta: float) -> tuple[float, ...]:
    """Coefficients of b, b², …, bⁿ in g."""
    return tuple(theta ** (k - 1) / factorial(k) for k in range(1, CURVE_DEGREE + 1))


def _derivative(theta: float) -> tuple[float, ...]:
    """Their derivatives by θ."""
    return (0.0, *((k - 1) * theta ** (k - 2) / factorial(k) for k in range(2, CURVE_DEGREE + 1)))


def _moments(residual: Float, derivative: Float) -> tuple[float, float, float]:
    """‖r‖², r · r′ and ‖r′‖²."""
    return float((residual**2).sum()), float((residual * derivative).sum()), float((derivative**2).sum())
