"""Cramér–Rao bounds: least covariances that photon noise allows any unbiased estimate of the motions.

Pixel i records a Poisson number of photons of mean N Tᵢ.  With θ all unknowns (the motions of all
particles together, and gain a and offset b of  −ln T → a (−ln T) + b  where they are free) the Fisher
information is

    F = Σᵢ N/Tᵢ (∂Tᵢ/∂θ)(∂Tᵢ/∂θ)ᵀ,   ∂T/∂θ = −s(p) ∂p/∂θ,   T = Σ_k w_k exp(−r_k p),   s = Σ_k w_k r_k exp(−r_k p)

over the spectrum (w, r), which is N e⁻ᵖ (∂p/∂θ)² for one energy.  A detector's blur is applied to T and
its derivatives alike.  p is the pixel's mean line integral through the whole sample, tube included.
The difference between averaging paths and averaging intensities within a pixel, and the noise of dark and
flat fields, are neglected.  Unobservable directions have an infinite variance.

∂p/∂θ comes from exact projections of each particle alone, by central differences.  Behind a round rim a ray's
path grows as the square root of its depth, so that the square of its derivative has no finite mean over a
pixel: only the derivative of the pixel's mean may be squared.  Differences over the whole distance between
two rays give exactly that, since the sum over the rays telescopes to the pixel's edges.  A shorter step
resolves the single rays and makes the bound too small (6 % for 3 × 3 rays and a step of 0.01 pixel).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.ndimage import gaussian_filter

from grainmotion._arguments import checked_arguments
from grainmotion._typing import Float, Progress
from grainmotion.model.geometry import Geometry
from grainmotion.rotations import rotation_matrix
from grainmotion.simulate.detector import Physics
from grainmotion.simulate.radiograph import transmission
from grainmotion.simulate.sample import Particle, Sample
from grainmotion.simulate.shapes import Ellipsoid

SINGULAR_EIGENVALUE_RATIO = 1e-10  # an eigenvalue of the information over the largest below which it is rounding error


@checked_arguments
def motion_bounds(
    sample: Sample,
    geometry: Geometry,
    physics: Physics,
    *,
    gain: bool = True,
    subsamples: int = 6,
    progress: Progress | None = None,
) -> Float:
    """Least covariances of the particles' motions that photon noise allows (Cramér–Rao bounds).

    Parameters
    ----------
    sample : Sample
        In the state of the radiographs.
    geometry : Geometry
        The views of the state.
    physics : Physics
        Its photons, spectrum and blur.
    gain : bool
        Whether one gain and one offset of all line integrals are unknown, too.
    subsamples : int
        Rays along each side of a pixel; 6 are within 0.5 % of the limit.  The differences are over half a
        distance between rays to each side, for rotations at the particle's farthest point.
    progress : callable, optional
        Called as ``progress(message, done, total)``.

    Returns
    -------
    (n, 6, 6) array
        Covariances of (ux, uy, uz, δx, δy, δz), mm and radians, sample frame: a translation of each particle and a
        rotation by exp[δ]ₓ about its centre.  Infinite on the diagonal, and NaN beside it, for components
        that the radiographs do not determine.

    Examples
    --------
    >>> gm.simulate.motion_bounds(case.sample, state.geometry, case.physics, subsamples=1).shape
    (4, 6, 6)
    """
    n = len(sample)
    radii = np.array([_radius(p) for p in sample.particles])
    information = np.zeros((6 * n + 2, 6 * n + 2))
    for view in range(len(geometry)):
        if progress:
            progress("bounds", view, len(geometry))
        one = geometry[view]
        fraction, derivative = _panel(sample, one, physics, subsamples)
        steps = [0.5 / subsamples * one.pixel_at(p.center) for p in sample.particles]
        rows = [
            _motion_derivatives(p, one, derivative, (step, step / radius), (subsamples, physics.blur))
            for p, step, radius in zip(sample.particles, steps, radii, strict=True)
        ]
        gain_and_offset = np.stack([-fraction * np.log(fraction), -fraction]).reshape(2, -1)
        jacobian = sparse.vstack([*rows, sparse.csr_array(gain_and_offset)], format="csr")
        weights = sparse.diags_array((physics.photons / fraction).ravel())
        information += (jacobian @ weights @ jacobian.T).toarray()
    if not gain:
        information = information[: 6 * n, : 6 * n]
    return _inverse_blocks(information, radii)


def _panel(sample: Sample, geometry: Geometry, physics: Physics, subsamples: int) -> tuple[Float, Float]:
    """Transmission of one view after the blur, and −∂T/∂p before it ``(rows, columns)``."""
    path = _paths(sample, geometry, subsamples)[0]
    shares, ratios = np.array(physics.spectrum, dtype=float).T
    transmitted = shares[:, None, None] / shares.sum() * np.exp(-ratios[:, None, None] * path)
    return _blurred(transmitted.sum(axis=0), physics.blur), (ratios[:, None, None] * transmitted).sum(axis=0)


def _paths(sample: Sample, geometry: Geometry, subsamples: int) -> Float:
    """Mean line integral of each pixel, in double precision ``(views, rows, columns)``."""
    return -np.log(transmission(sample, geometry, subsamples=subsamples, averaging="line-integral"))


def _blurred(image: Float, blur: float) -> Float:
    return gaussian_filter(image, blur, mode="nearest") if blur > 0 else image


def _motion_derivatives(
    particle: Particle, geometry: Geometry, derivative: Float, steps: tuple[float, float], detector: tuple[int, float]
) -> sparse.csr_array:
    """−∂T/∂(u, δ) of one view with respect to one particle's motion ``(6, pixels)``.

    ``derivative`` is −∂T/∂p, ``steps`` are of translations (mm) and rotations (radians), ``detector`` is the number of
    rays along a pixel's side and the blur.
    """
    subsamples, blur = detector
    images = np.zeros((6, *geometry.shape))
    first, shape = _window(particle, geometry, 2 + int(np.ceil(4 * blur)))
    box = slice(first[0], first[0] + shape[0]), slice(first[1], first[1] + shape[1])
    center = particle.center
    for k in range(6 if 0 not in shape else 0):
        paths = []
        for sign in (1.0, -1.0):
            change = np.zeros(6)
            change[k] = sign * steps[k // 3]
            rotation = rotation_matrix(change[3:])
            moved = particle.moved(rotation, center - rotation @ center + change[:3])
            paths.append(_paths(Sample((moved,)), geometry.window(first, shape), subsamples)[0])
        images[k, *box] = _blurred(derivative[box] * (paths[0] - paths[1]) / (2 * steps[k // 3]), blur)
    return sparse.csr_array(images.reshape(6, -1))


def _window(particle: Particle, geometry: Geometry, margin: int) -> tuple[tuple[int, int], tuple[int, int]]:
    """First pixel and shape of the window around a particle's footprint; empty if it is off the panel."""
    pixels = geometry.project_points(particle.shape.outline)[0]
    low = np.floor(pixels.min(axis=0)) - margin
    high = np.ceil(pixels.max(axis=0)) + margin + 1
    limit = np.array(geometry.shape)
    first = np.clip(low, 0, limit).astype(int)
    rows, columns = (int(k) for k in np.clip(high, first, limit).astype(int) - first)
    return (int(first[0]), int(first[1])), (rows, columns)


def _radius(particle: Particle) -> float:
    """Distance of the farthest point of a particle from its centre, mm; for an ellipsoid an upper bound."""
    shape = particle.shape
    if isinstance(shape, Ellipsoid):
        return float(np.linalg.norm(shape.center - particle.center) + shape.semi_axes.max())
    return float(np.linalg.norm(shape.vertices - particle.center, axis=1).max())


def _inverse_blocks(information: Float, radii: Float) -> Float:
    """The 6 × 6 blocks of the inverse; undetermined components are infinite."""
    n, size = len(radii), len(information)
    units = np.ones(size)  # rotations as displacements of the farthest point, gain and offset scaled like the motions
    units[: 6 * n].reshape(n, 6)[:, 3:] = radii[:, None]
    top = (np.diagonal(information)[: 6 * n] / units[: 6 * n] ** 2).max(initial=0.0)
    for k in range(6 * n, size):
        units[k] = np.sqrt(information[k, k] / top) if information[k, k] > 0 and top > 0 else 1.0
    values, vectors = np.linalg.eigh(information / np.outer(units, units))
    regular = values > SINGULAR_EIGENVALUE_RATIO * max(values.max(initial=0.0), 1e-300)
    null_share = (vectors[:, ~regular] ** 2).sum(axis=1)
    rows = (vectors[:, regular] / np.sqrt(values[regular])) / units[:, None]
    blocks: NDArray[np.float64] = np.empty((n, 6, 6))
    for i in range(n):
        at = slice(6 * i, 6 * i + 6)
        blocks[i] = rows[at] @ rows[at].T
        undetermined = null_share[at] > 1e-6
        blocks[i, undetermined, :] = np.nan
        blocks[i, :, undetermined] = np.nan
        blocks[i, undetermined, undetermined] = np.inf
    return blocks
