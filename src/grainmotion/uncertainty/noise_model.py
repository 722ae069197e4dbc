"""Noise model: the variance of each pixel, from photon statistics and from the residuals, and weights from it.

The variance of a pixel is modelled as  v = e^m/(N f) + d² + s² + g²|∇m|²,  with m its line integral, N the photons
of the open beam and f its shape (the flat), d noise that does not depend on the beam, s an even model error and g
one of edges, in pixels of displacement.  N and d come from differences of neighbouring pixels, s and g from the
residuals beyond them.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import nnls

from grainmotion._typing import Float, Image
from grainmotion.model.scan import Scan
from grainmotion.objective.data_term import Target
from grainmotion.objective.evaluation import Evaluation

Weights = Literal["uniform", "photons"]
Loss = Literal["squares", "huber", "poisson"]

HUBER_SD = 3.0
"""Standard deviations beyond which a residual counts linearly; those of noise and voxels rarely exceed it."""
NOISE_CLASSES, VARIANCE_REFITS = 8, 4
"""Classes of pixels by their photon noise; fits of the two variances to these."""
PIXELS_OF_NOISE = 1 << 20
"""Pixels that show the noise, every second, third, ... row of radiographs that have more."""
MEDIAN_NORMAL_SQUARE = 0.4549
"""Median of the squares of numbers that are normal with variance 1."""
MIN_TRUST = 0.5
"""Discount of a pixel down to which its residual counts for the model errors of the others."""
SHADED_SHARE = 0.02
"""Share of the largest line integral from which a pixel is shaded."""
MAX_LINE_INTEGRAL = 12.0
"""Line integrals are cut to this: beyond it hardly a photon arrives."""


@dataclass(frozen=True)
class NoiseModel:
    """The variance of pixels, as at the top of this module.

    Attributes
    ----------
    photons : float
        N, detected photons of the open beam a pixel; infinite where there is no noise.
    even, edge : float
        √(d² + s²) (line-integral units) and g (pixels).
    """

    photons: float
    even: float
    edge: float

    def variance(self, modelled: Image, beam: Image | float) -> Float:
        """v of each pixel of simulated radiographs ``(views, rows, columns)``."""
        return self.photon_variance(modelled, beam) + self.even**2 + self.edge**2 * squared_gradient(modelled)

    def photon_variance(self, modelled: Image, beam: Image | float) -> Float:
        """The part of v that is due to photons."""
        return np.exp(np.clip(modelled, -MAX_LINE_INTEGRAL, MAX_LINE_INTEGRAL).astype(float)) / (
            self.photons * np.asarray(beam, float)
        )


def noise_model(target: Target, evaluation: Evaluation, clip: float = np.inf) -> NoiseModel:
    """Estimate the noise of a state from its residuals, those beyond ``clip`` standard deviations cut to these."""
    modelled = evaluation.response.apply(evaluation.line_integrals)
    unit = NoiseModel(1.0, 0.0, 0.0).photon_variance(modelled, open_beam(target))
    share, white = noise_shares(evaluation.raw_residual, unit, target.valid > 0)
    shaded = shaded_pixels(target, evaluation) & (target.trust >= MIN_TRUST)
    photons = 1 / share if share > 0 else np.inf
    if not shaded.any():
        return NoiseModel(photons, float(np.sqrt(white)), 0.0)
    squares, known = evaluation.raw_residual[shaded].astype(float) ** 2, share * unit[shaded] + white
    columns = np.stack([np.ones(len(squares)), squared_gradient(modelled)[shaded]], axis=1)
    even = edge = 0.0
    for _ in range(VARIANCE_REFITS if np.isfinite(clip) else 1):
        limit = clip**2 * np.maximum(known + columns @ [even, edge], 1e-12)
        even, edge = nnls(columns.T @ columns, columns.T @ (np.minimum(squares, limit) - known))[0]
    return NoiseModel(photons, float(np.sqrt(even + white)), float(np.sqrt(edge)))


def noise_shares(raw: Image, unit: Float, good: NDArray[np.bool_]) -> tuple[float, float]:
    """Variance of the noise as a share of ``unit`` and an even rest.

    From the spread of second differences of residuals along rows, robust, in classes of ``unit``.
    """
    if raw.shape[2] < 3:
        return 0.0, 0.0
    some = slice(None, None, max(1, -(-raw.size // PIXELS_OF_NOISE)))
    raw, unit, good = raw[:, some], unit[:, some], good[:, some]
    second = _second_differences(raw.astype(float))
    whole = good[:, :, 2:] & good[:, :, 1:-1] & good[:, :, :-2]
    squares, units = second[whole] ** 2 / 6, unit[:, :, 1:-1][whole]
    if len(squares) < NOISE_CLASSES:
        return 0.0, 0.0
    edges = np.geomspace(units.min(), units.max() * (1 + 1e-9), NOISE_CLASSES + 1)
    place = np.clip(np.searchsorted(edges, units, side="right") - 1, 0, NOISE_CLASSES - 1)
    classes = [place == k for k in np.unique(place)]
    rows = np.array([[units[members].mean(), 1.0] for members in classes])
    values = np.array([np.median(squares[members]) / MEDIAN_NORMAL_SQUARE for members in classes])
    roots = np.sqrt([members.sum() for members in classes])
    share = white = 0.0
    fitted = rows[:, 0]
    for _ in range(VARIANCE_REFITS):  # the error of a variance goes with the fitted one: a small class may show none
        scale = roots / np.maximum(fitted, 1e-30)
        share, white = nnls(rows * scale[:, None], values * scale)[0]
        fitted = rows @ [share, white]
    return float(share), float(white)


def pixel_variances(target: Target, evaluation: Evaluation) -> Float:
    """Variance of the noise alone of each pixel ``(views, rows, columns)``, from differences of residuals."""
    modelled = evaluation.response.apply(evaluation.line_integrals)
    unit = NoiseModel(1.0, 0.0, 0.0).photon_variance(modelled, open_beam(target))
    share, white = noise_shares(evaluation.raw_residual, unit, target.valid > 0)
    return share * unit + white


def noise_level(scan: Scan) -> float:
    """Noise of a pixel, line-integral units: robust spread of second differences along rows."""
    if scan.line_integrals.shape[2] < 3:
        return 0.0
    return float(1.4826 * np.median(np.abs(_second_differences(scan.line_integrals))) / np.sqrt(6))


def _second_differences(images: Image) -> Image:
    """Second differences along rows: zero of a smooth image, and of six times the variance of the noise."""
    return images[:, :, 2:] - 2 * images[:, :, 1:-1] + images[:, :, :-2]


def shaded_pixels(target: Target, evaluation: Evaluation) -> NDArray[np.bool_]:
    """Pixels that count and lie in a simulated footprint."""
    largest = max(float(evaluation.line_integrals.max(initial=0.0)), 1e-30)
    return (target.valid > 0) & (evaluation.line_integrals > SHADED_SHARE * largest)


def squared_gradient(images: Image) -> Float:
    """|∇m|² of every pixel, per pixel squared."""
    steps = [np.gradient(images, axis=axis) for axis in (1, 2) if images.shape[axis] > 1]
    return sum((s.astype(float) ** 2 for s in steps), np.zeros(images.shape))


def open_beam(target: Target) -> Image | float:
    """Shape of the open beam ``(rows, columns)``, of mean 1; 1 where it is not known."""
    return 1.0 if target.scan.open_beam is None else target.scan.open_beam


def reweighted(target: Target, evaluation: Evaluation, weights: Weights, loss: Loss) -> tuple[Target, float]:
    """The target with weights, and for photons' likelihood the response, that fit at a pose.

    Returns
    -------
    Target
        To be solved again; iterated, it ends at the minimum of the loss.
    float
        Share of the shaded pixels that the loss counts less than others.
    """
    modelled, beam = evaluation.response.apply(evaluation.line_integrals), open_beam(target)
    if loss == "poisson":
        # Fisher scoring: the weighted gap to this response is the gradient of the likelihood of n = N f e^−b counts.
        gap = 1 - np.exp(np.clip(-evaluation.raw_residual, -MAX_LINE_INTEGRAL, MAX_LINE_INTEGRAL))
        scan = replace(target.scan, line_integrals=(modelled + gap).astype(target.precision))
        counts = 1 / NoiseModel(1.0, 0.0, 0.0).photon_variance(modelled, beam)
        return replace(target, scan=scan, sigma=0.0, weights=_unit_mean(counts, target)), 0.0
    noise = noise_model(target, evaluation, HUBER_SD if loss == "huber" else np.inf)
    variance = noise.variance(modelled, beam)
    weight = _unit_mean(1 / np.maximum(variance, 1e-12), target) if weights == "photons" else np.ones_like(variance)
    if loss == "squares":
        return replace(target, weights=weight), 0.0
    size = np.abs(evaluation.raw_residual) / np.sqrt(np.maximum(variance, 1e-12))
    shaded = shaded_pixels(target, evaluation)
    weight = weight * np.minimum(1.0, HUBER_SD / np.maximum(size, 1e-12))
    share = float((size[shaded] > HUBER_SD).mean()) if shaded.any() else 0.0
    return replace(target, weights=weight), share


def _unit_mean(weights: Float, target: Target) -> Float:
    """Weights of mean 1 over the pixels that count."""
    return weights / max(float(weights[target.valid > 0].mean()) if target.valid.any() else 1.0, 1e-30)
