"""Linearisation of beam hardening by a curve fitted to a scan and its reconstruction.

A polychromatic beam is attenuated less and less with depth, so that the measured line integral b grows more slowly than
the path.  The reprojection t of a template of the sample, in which all material, or each grain, has one attenuation, is
proportional to the path.  Herman's linearisation (Physics in Medicine and Biology 24, 1979) is the fit

    t ≈ s g(b),   g(b) = b + c₂ b² + … + c_n bⁿ,   c_k ≥ 0,

over all pixels that show the sample.  Coefficients that are not negative make g monotone and convex, as the
physics requires.  The scale s is not applied: thin paths stay as they are, and the corrected attenuation is that
of the unhardened beam.  Where the departure from linear is not significant, g is the identity.
"""

from __future__ import annotations

import dataclasses
from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import Field
from scipy import ndimage
from scipy.optimize import nnls
from skimage.filters import threshold_otsu

from grainmotion._arguments import checked_arguments
from grainmotion._typing import Float, Projector
from grainmotion._validation import validated
from grainmotion.errors import InputError
from grainmotion.model.scan import Scan
from grainmotion.model.volume import Volume
from grainmotion.projection.volumes import project

JACKKNIFE_GROUPS = 8
"""Groups of views that are left out in turn, for the standard deviation of the curve."""
SIGNIFICANT_SD = 3.0
"""Standard deviations from which a departure from linear is significant."""
MIN_DEPARTURE = 0.02
"""Smallest relative departure on the longest path that counts as hardening: partly filled voxels cause less."""
LONGEST_PERCENTILE = 99.5
"""Percentile of the line integrals that stands for the longest path."""
MIN_PATH = 0.2
"""Shortest path that is fitted, over the longest: shorter ones depend on surfaces more than on material."""


@validated
class HardeningSettings:
    """How to fit the curve of beam hardening."""

    degree: Annotated[int, Field(ge=2, le=4, description="degree of the curve")] = 3
    threshold: Annotated[
        float | None, Field(description="attenuation from which a voxel is material, 1/mm; Otsu's unless given")
    ] = None
    views: Annotated[int, Field(ge=JACKKNIFE_GROUPS, description="most views on which the template is projected")] = 64
    projector: Annotated[Projector, Field(description="as the reconstruction's")] = "trilinear"


@validated
class Hardening:
    """The curve g(b) = Σ c_k bᵏ from measured to linear line integrals.

    Attributes
    ----------
    coefficients : tuple of float
        c₁ = 1, c₂, …, none negative.
    longest : float
        Line integral up to which the curve was fitted; 99.5 % of those of the sample lie below.
    sd : float
        Standard deviation of `departure`.
    """

    coefficients: tuple[float, ...] = (1.0,)
    longest: float = 0.0
    sd: float = 0.0

    def __post_init__(self) -> None:
        c = self.coefficients
        if not c or c[0] != 1 or min(c) < 0 or not np.isfinite(c).all():
            raise InputError("hardening", f"coefficients {c}", "the first must be 1, and none may be negative")

    @property
    def is_linear(self) -> bool:
        """Whether the curve is the identity."""
        return not any(self.coefficients[1:])

    @property
    def departure(self) -> float:
        """How far the longest path is from linear: g(b)/b − 1."""
        return float(self(np.array(self.longest)) / self.longest - 1) if self.longest > 0 else 0.0

    def __call__(self, line_integrals: NDArray[np.floating]) -> NDArray[np.floating]:
        """g(b), in the precision of b; negative values, which are noise, stay as they are."""
        b = np.maximum(line_integrals, 0)
        higher = np.zeros_like(b)
        for c in self.coefficients[:0:-1]:
            higher = b * (higher + b.dtype.type(c))
        return line_integrals + b * higher

    def apply(self, scan: Scan) -> Scan:
        """Linearise a scan.

        Parameters
        ----------
        scan : Scan
            As measured.

        Returns
        -------
        Scan
            Its line integrals as a monochromatic beam would have given them.
        """
        return scan if self.is_linear else dataclasses.replace(scan, line_integrals=self(scan.line_integrals))

    def __str__(self) -> str:
        if self.is_linear:
            return f"no beam hardening beyond {SIGNIFICANT_SD:.0f} sd ({100 * self.sd:.2g} %)"
        return f"beam hardening of {100 * self.departure:.1f} ± {100 * self.sd:.1f} % on the longest path"


@checked_arguments
def calibrate_hardening(
    scan: Scan,
    volume: Volume,
    settings: HardeningSettings | None = None,
    *,
    labels: NDArray[np.integer] | None = None,
) -> Hardening:
    """Fit the curve of beam hardening to a full scan and its first reconstruction.

    Parameters
    ----------
    scan : Scan
        As measured.
    volume : Volume
        Reconstructed from it, 1/mm.
    settings : HardeningSettings, optional
        Degree, threshold and number of views.
    labels : (nz, ny, nx) integer array, optional
        Grains.  Where given, a template with each grain at its own mean attenuation is compared with the one of
        connected pieces of material at their means, and the one that fits the radiographs better is used.

    Returns
    -------
    Hardening
        To be applied to this scan before it is reconstructed again, and to those of the states.  The identity if
        the data show no hardening.

    Raises
    ------
    InputError
        If no voxel lies above the threshold, or the scan has too few views.
    """
    settings = settings or HardeningSettings()
    if len(scan) < JACKKNIFE_GROUPS:
        raise InputError("hardening", f"{len(scan)} views", f"give the full scan, {JACKKNIFE_GROUPS} views at least")
    views = scan.select(np.unique(np.linspace(0, len(scan) - 1, min(settings.views, len(scan))).astype(int)))
    parts = [_pieces(volume, settings)] if labels is None else [_pieces(volume, settings), labels]
    curves = [_curve(views, _template(volume, part), settings) for part in parts]
    return min(curves, key=lambda curve: curve[0])[1]


def _curve(scan: Scan, template: Volume, settings: HardeningSettings) -> tuple[float, Hardening]:
    """Relative misfit ‖t − s g(b)‖/‖t‖ of a template, and the curve."""
    t = project(template, scan.geometry, projector=settings.projector)
    b = scan.line_integrals.astype(float)
    material = t > 0 if scan.valid is None else (t > 0) & scan.valid
    if not material.any():
        raise InputError("hardening", "no radiograph shows the material", "check the threshold and the volume")
    longest = float(np.percentile(b[material], LONGEST_PERCENTILE))
    used = material & (b > MIN_PATH * longest)
    group = np.broadcast_to((np.arange(len(scan)) % JACKKNIFE_GROUPS)[:, None, None], b.shape)[used]
    x, y = b[used] / longest, t[used].astype(float)
    moments = [_moments(x[group == k], y[group == k], settings.degree) for k in range(JACKKNIFE_GROUPS)]
    whole = np.sum(moments, axis=0)
    c, misfit = _fit(whole)
    # jackknife: the variance of the curve fitted without one group of views
    spread = [float(_fit(whole - m)[0][1:].sum()) for m in moments]
    sd = float(np.sqrt((JACKKNIFE_GROUPS - 1) * np.var(spread)))
    if c[1:].sum() < max(SIGNIFICANT_SD * sd, MIN_DEPARTURE):
        return misfit, Hardening((1.0,), longest, sd)
    return misfit, Hardening(tuple(float(k) for k in c / longest ** np.arange(len(c))), longest, sd)


def _pieces(volume: Volume, settings: HardeningSettings) -> NDArray[np.integer]:
    """Connected components of the voxels above the threshold, numbered 1 … n."""
    array = volume.array
    if array.max() <= array.min():
        raise InputError("hardening", "the volume is uniform", "check the reconstruction")
    threshold = float(threshold_otsu(array)) if settings.threshold is None else settings.threshold
    pieces, n = ndimage.label(array > threshold)
    if n == 0:
        raise InputError("hardening.threshold", f"no voxel above {threshold:.4g} 1/mm", "lower it")
    return np.asarray(pieces)


def _template(volume: Volume, labels: NDArray[np.integer]) -> Volume:
    """The volume with each label at its mean attenuation, and zero elsewhere."""
    if labels.shape != volume.shape:
        fact = f"labels of {labels.shape} voxels, the volume of {volume.shape}"
        raise InputError("hardening", fact, "give the labels of that volume")
    counts = np.bincount(labels.ravel())
    means = np.bincount(labels.ravel(), volume.array.ravel()) / np.maximum(counts, 1)
    means[0] = 0
    return Volume(means.astype(volume.array.dtype)[labels], volume.voxel_size, volume.center)


def _moments(b: Float, t: Float, degree: int) -> Float:
    """Sums of products of b, b², …, bⁿ and t, sufficient for a least-squares fit, ``(n + 1, n + 1)``."""
    columns = np.stack([b**k for k in range(1, degree + 1)] + [t])
    return columns @ columns.T


def _fit(moments: Float) -> tuple[Float, float]:
    """Non-negative c₁ = 1, c₂, … of the least-squares fit with these moments, and its relative misfit."""
    normal, right, square = moments[:-1, :-1], moments[:-1, -1], moments[-1, -1]
    root = np.linalg.cholesky(normal + 1e-12 * np.trace(normal) * np.eye(len(normal)))
    c = nnls(root.T, np.linalg.solve(root, right))[0]
    misfit = np.sqrt(max(0.0, square - 2 * c @ right + c @ normal @ c) / square)
    return (c / c[0] if c[0] > 0 else np.eye(len(c))[0]), float(misfit)
