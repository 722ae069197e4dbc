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

from collections.abc import Callable, Sequence
from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import Field
from scipy import ndimage
from scipy.optimize import nnls

from grainmotion._arguments import checked_arguments
from grainmotion._typing import Float, Image, Projector
from grainmotion._validation import validated
from grainmotion.errors import InputError
from grainmotion.model.geometry import Geometry
from grainmotion.model.hardening import SIGNIFICANT_SD, Hardening
from grainmotion.model.label_sums import label_sizes, label_sums
from grainmotion.model.quantiles import quantile_of_parts
from grainmotion.model.scan import Scan
from grainmotion.model.slabs import slabs
from grainmotion.model.volume import Volume
from grainmotion.preprocessing.volume_threshold import otsu
from grainmotion.projection.volumes import project

__all__ = ["Hardening", "HardeningSettings", "calibrate_hardening"]

JACKKNIFE_GROUPS = 8
"""Groups of views that are left out in turn, for the standard deviation of the curve."""
MIN_DEPARTURE = 0.02
"""Smallest relative departure on the longest path that counts as hardening: partly filled voxels cause less."""
LONGEST_SHARE = 0.995
"""Quantile of the line integrals that stands for the longest path."""
MIN_PATH = 0.2
"""Shortest path that is fitted, over the longest: shorter ones depend on surfaces more than on material."""
Parts = Callable[[], NDArray[np.integer]]
"""Makes labels of parts of the sample, each of one attenuation."""


@validated
class HardeningSettings:
    """How to fit the curve of beam hardening.

    Examples
    --------
    >>> gm.HardeningSettings(degree=2).degree
    2
    """

    degree: Annotated[int, Field(ge=2, le=4, description="degree of the curve")] = 3
    threshold: Annotated[
        float | None, Field(description="attenuation from which a voxel is material, 1/mm; Otsu's unless given")
    ] = None
    views: Annotated[int, Field(ge=JACKKNIFE_GROUPS, description="most views on which the template is projected")] = 64
    projector: Annotated[Projector, Field(description="as the reconstruction's")] = "trilinear"


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

    Examples
    --------
    >>> curve = gm.calibrate_hardening(case.reference(), volume, gm.HardeningSettings(views=8))
    >>> curve.is_linear  # this beam has one energy
    True
    """
    settings = settings or HardeningSettings()
    parts: list[Parts] = [lambda: np.asarray(ndimage.label(material_mask(volume, settings))[0])]
    return best_hardening(scan, volume, settings, parts if labels is None else [*parts, lambda: labels])


def best_hardening(scan: Scan, volume: Volume, settings: HardeningSettings, parts: Sequence[Parts]) -> Hardening:
    """The curve of `calibrate_hardening` whose template fits best; labels of templates are made one after the other."""
    if len(scan) < JACKKNIFE_GROUPS:
        raise InputError("hardening", f"{len(scan)} views", f"give the full scan, {JACKKNIFE_GROUPS} views at least")
    views = scan.select(np.unique(np.linspace(0, len(scan) - 1, min(settings.views, len(scan))).astype(int)))
    curves = [
        _curve(views, _projected_template(volume, labels(), views.geometry, settings), settings) for labels in parts
    ]
    return min(curves, key=lambda curve: curve[0])[1]


def _curve(scan: Scan, t: Image, settings: HardeningSettings) -> tuple[float, Hardening]:
    """Relative misfit ‖t − s g(b)‖/‖t‖ of the line integrals t of a template, and the curve."""
    material = [(own > 0) if scan.valid is None else (own > 0) & scan.valid[k] for k, own in enumerate(t)]
    if not any(own.any() for own in material):
        raise InputError("hardening", "no radiograph shows the material", "check the threshold and the volume")
    images = scan.line_integrals
    longest = quantile_of_parts(lambda: (b[own] for b, own in zip(images, material, strict=True)), LONGEST_SHARE)
    moments = np.zeros((JACKKNIFE_GROUPS, settings.degree + 1, settings.degree + 1))
    for k, (b, own, own_t) in enumerate(zip(images, material, t, strict=True)):
        used = own & (b > MIN_PATH * longest)
        x = b[used].astype(float) / longest
        moments[k % JACKKNIFE_GROUPS] += _moments(x, own_t[used].astype(float), settings.degree)
    whole = np.sum(moments, axis=0)
    c, misfit = _fit(whole)
    # jackknife: the variance of the curve fitted without one group of views
    spread = [float(_fit(whole - m)[0][1:].sum()) for m in moments]
    sd = float(np.sqrt((JACKKNIFE_GROUPS - 1) * np.var(spread)))
    if c[1:].sum() < max(SIGNIFICANT_SD * sd, MIN_DEPARTURE):
        return misfit, Hardening((1.0,), longest, sd)
    return misfit, Hardening(tuple(float(k) for k in c / longest ** np.arange(len(c))), longest, sd)


def material_mask(volume: Volume, settings: HardeningSettings) -> NDArray[np.bool_]:
    """Voxels above the threshold; an `InputError` if there are none."""
    array = volume.array
    if array.max() <= array.min():
        raise InputError("hardening", "the volume is uniform", "check the reconstruction")
    threshold = otsu(array) if settings.threshold is None else settings.threshold
    mask = array > threshold
    if not mask.any():
        raise InputError("hardening.threshold", f"no voxel above {threshold:.4g} 1/mm", "lower it")
    return np.asarray(mask)


def _projected_template(
    volume: Volume, labels: NDArray[np.integer], geometry: Geometry, settings: HardeningSettings
) -> Image:
    """Line integrals of the volume with each label at its mean attenuation, and zero elsewhere.

    They are sums over slabs, as each voxel adds its own share to a ray: no template of the whole volume is made.
    """
    if labels.shape != volume.shape:
        fact = f"labels of {labels.shape} voxels, the volume of {volume.shape}"
        raise InputError("hardening", fact, "give the labels of that volume")
    means = label_sums(labels, volume.array) / np.maximum(label_sizes(labels), 1)
    means[0] = 0
    values = means.astype(volume.array.dtype)
    total = np.zeros((len(geometry), *geometry.shape), values.dtype)
    for planes, _ in slabs(len(labels)):
        template = np.take(values, labels[planes], mode="clip")
        x, y, z = volume.center
        z += volume.voxel_size * ((planes.start + planes.stop) - len(labels)) / 2
        total += project(Volume(template, volume.voxel_size, (x, y, z)), geometry, projector=settings.projector)
    return total


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
