"""Cramér–Rao bounds: how well any unbiased method can know the motions of true shapes from photon noise.

Pixel i records a Poisson number of photons of mean N Tᵢ.  With θ all unknowns (the motions of all
particles together, and gain a and offset b of  −ln T → a (−ln T) + b  where they are free) the Fisher
information is

    F = Σᵢ N/Tᵢ (∂Tᵢ/∂θ)(∂Tᵢ/∂θ)ᵀ,   ∂T/∂θ = −s(p) ∂p/∂θ,   T = Σ_k w_k exp(−r_k p),   s = Σ_k w_k r_k exp(−r_k p)

over the spectrum (w, r), which is N e⁻ᵖ (∂p/∂θ)² for one energy.  A detector's blur is applied to T and
its derivatives alike.  p is the pixel's mean line integral through the whole sample, tube included;
the difference between averaging paths and averaging intensities within a pixel, and the noise of dark and
flat fields, are left out.  Directions that the radiographs do not tell at all have an infinite variance.

∂p/∂θ comes from exact renders of each particle alone, by central differences.  A ray's path grows as the
square root of its depth behind a round rim, so that the square of its derivative has no finite mean over a
pixel: only the derivative of the pixel's mean may be squared.  Differences over a whole distance between
two rays give just that, since what lies between the rays telescopes to the pixel's edges; a shorter step
feels the single rays and makes the bound too small (6 % for 3 × 3 rays and a step of 0.01 pixel).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from grainmotion._typing import Float, Progress
from grainmotion.model.geometry import Geometry
from grainmotion.rotations import rotation_matrix
from grainmotion.simulate.detector import Physics
from grainmotion.simulate.radiograph import transmission
from grainmotion.simulate.sample import Particle, Sample
from grainmotion.simulate.shapes import Ellipsoid

UNTOLD = 1e-10  # an eigenvalue of the information over the largest: nothing but rounding


class _Patch(NamedTuple):
    """The part of a panel that one particle shades, and −∂T/∂(u, δ) there ``(6, rows, columns)``."""

    row: int
    column: int
    images: Float

    @property
    def box(self) -> tuple[slice, slice]:
        rows, columns = self.images.shape[1:]
        return slice(self.row, self.row + rows), slice(self.column, self.column + columns)


def motion_bounds(
    sample: Sample,
    geometry: Geometry,
    physics: Physics,
    *,
    gain: bool = True,
    subsamples: int = 6,
    progress: Progress | None = None,
) -> Float:
    """Least covariances of the particles' motions that photon noise allows.

    Parameters
    ----------
    sample : Sample
        In the state that is seen.
    geometry : Geometry
        The views of the state.
    physics : Physics
        Its photons, spectrum and blur.
    gain : bool
        Whether one gain and one offset of all line integrals are unknown, too.
    subsamples : int
        Rays along each side of a pixel: 6 are within 0.5 % of many.  The differences are over half a
        distance between rays to each side, for turns at the particle's farthest point.
    progress : callable, optional
        Called as ``progress(message, done, total)``.

    Returns
    -------
    (n, 6, 6) float64 array
        Covariances of (ux, uy, uz, δx, δy, δz), mm and radians, sample frame: a shift of each particle and a
        turn by exp[δ]ₓ about its centre.  Infinite on the diagonal, and NaN beside it, for components
        that the radiographs do not tell.
    """
    n = len(sample)
    size = 6 * n + 2
    radii = np.array([_radius(p) for p in sample.particles])
    information = np.zeros((size, size))
    for view in range(len(geometry)):
        if progress:
            progress("bounds", view, len(geometry))
        one = geometry[view]
        seen, slope = _panel(sample, one, physics, subsamples)
        weight = physics.photons / seen
        steps = [0.5 / subsamples * one.pixel_at(p.center) for p in sample.particles]
        patches = [
            _patch(p, one, slope, (step, step / radius), (subsamples, physics.blur))
            for p, step, radius in zip(sample.particles, steps, radii, strict=True)
        ]
        _accumulate(information, patches, weight, np.stack([-seen * np.log(seen), -seen]))
    if not gain:
        information = information[: 6 * n, : 6 * n]
    return _inverse_blocks(information, radii)


def _panel(sample: Sample, geometry: Geometry, physics: Physics, subsamples: int) -> tuple[Float, Float]:
    """Transmission of one view after the blur, and −∂T/∂p before it ``(rows, columns)``."""
    path = _paths(sample, geometry, subsamples)[0]
    shares, ratios = np.array(physics.spectrum, dtype=float).T
    each = shares[:, None, None] / shares.sum() * np.exp(-ratios[:, None, None] * path)
    return _blurred(each.sum(axis=0), physics.blur), (ratios[:, None, None] * each).sum(axis=0)


def _paths(sample: Sample, geometry: Geometry, subsamples: int) -> Float:
    """Mean line integral of each pixel, in double precision ``(views, rows, columns)``."""
    return -np.log(transmission(sample, geometry, subsamples=subsamples, averaging="line-integral"))


def _blurred(image: Float, blur: float) -> Float:
    return gaussian_filter(image, blur, mode="nearest") if blur > 0 else image


def _patch(
    particle: Particle, geometry: Geometry, slope: Float, steps: tuple[float, float], detector: tuple[int, float]
) -> _Patch:
    """Derivatives of one view's transmission with respect to one particle's motion, on its own window.

    ``steps`` are of translations (mm) and rotations (radians), ``detector`` rays a side and blur.
    """
    subsamples, blur = detector
    first, shape = _window(particle, geometry, 2 + int(np.ceil(4 * blur)))
    if 0 in shape:
        return _Patch(0, 0, np.zeros((6, 0, 0)))
    window = geometry.window(first, shape)
    patch = _Patch(*first, np.empty((6, *shape)))
    center = particle.center
    for k in range(6):
        paths = []
        for sign in (1.0, -1.0):
            change = np.zeros(6)
            change[k] = sign * steps[k // 3]
            turn = rotation_matrix(change[3:])
            moved = particle.moved(turn, center - turn @ center + change[:3])
            paths.append(_paths(Sample((moved,)), window, subsamples)[0])
        derivative = (paths[0] - paths[1]) / (2 * steps[k // 3])
        patch.images[k] = _blurred(slope[patch.box] * derivative, blur)
    return patch


def _window(particle: Particle, geometry: Geometry, margin: int) -> tuple[tuple[int, int], tuple[int, int]]:
    """First pixel and shape of the part of the panel around a particle's shadow; empty if it is off the panel."""
    seen = geometry.project_points(_outline(particle))[0]
    low = np.floor(seen.min(axis=0)) - margin
    high = np.ceil(seen.max(axis=0)) + margin + 1
    limit = np.array(geometry.shape)
    first = np.clip(low, 0, limit).astype(int)
    last = np.clip(high, first, limit).astype(int)
    rows, columns = (int(k) for k in last - first)
    return (int(first[0]), int(first[1])), (rows, columns)


def _outline(particle: Particle) -> Float:
    """Points that a particle lies between, mm."""
    shape = particle.shape
    if isinstance(shape, Ellipsoid):
        signs = np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1])).reshape(3, -1).T
        return shape.center + (signs * shape.semi_axes) @ shape.axes.T
    return shape.vertices


def _radius(particle: Particle) -> float:
    """How far the farthest point of a particle is from its centre, mm."""
    shape = particle.shape
    if isinstance(shape, Ellipsoid):
        return float(np.linalg.norm(shape.center - particle.center) + shape.semi_axes.max())
    return float(np.linalg.norm(shape.vertices - particle.center, axis=1).max())


def _accumulate(information: Float, patches: list[_Patch], weight: Float, scene: Float) -> None:
    """Add one view's information about all motions and about gain and offset (``scene``, (2, rows, columns))."""
    information[-2:, -2:] += np.einsum("arc,brc,rc->ab", scene, scene, weight)
    for i, a in enumerate(patches):
        at = slice(6 * i, 6 * i + 6)
        weighted = a.images * weight[a.box]
        with_scene = np.einsum("krc,brc->kb", weighted, scene[:, *a.box])
        information[at, -2:] += with_scene
        information[-2:, at] += with_scene.T
        for j in range(i, len(patches)):
            b = patches[j]
            shared = _overlap(a, b)
            if shared is None:
                continue
            block = weighted[shared[0]].reshape(6, -1) @ b.images[shared[1]].reshape(6, -1).T
            to = slice(6 * j, 6 * j + 6)
            information[at, to] += block
            if j > i:
                information[to, at] += block.T


Cut = tuple[slice, slice, slice]


def _overlap(a: _Patch, b: _Patch) -> tuple[Cut, Cut] | None:
    """The pixels that two patches share, as cuts of the one's images and of the other's."""
    top, left = max(a.row, b.row), max(a.column, b.column)
    bottom = min(a.row + a.images.shape[1], b.row + b.images.shape[1])
    right = min(a.column + a.images.shape[2], b.column + b.images.shape[2])
    if bottom <= top or right <= left:
        return None
    first, second = (
        (slice(None), slice(top - p.row, bottom - p.row), slice(left - p.column, right - p.column)) for p in (a, b)
    )
    return first, second


def _inverse_blocks(information: Float, radii: Float) -> Float:
    """The 6 × 6 blocks of the inverse; what is not told is infinite."""
    n, size = len(radii), len(information)
    units = np.ones(size)  # rotations as the way of the farthest point, gain and offset in their own deviations
    units[: 6 * n].reshape(n, 6)[:, 3:] = radii[:, None]
    top = (np.diagonal(information)[: 6 * n] / units[: 6 * n] ** 2).max(initial=0.0)
    for k in range(6 * n, size):
        units[k] = np.sqrt(information[k, k] / top) if information[k, k] > 0 and top > 0 else 1.0
    values, vectors = np.linalg.eigh(information / np.outer(units, units))
    told = values > UNTOLD * max(values.max(initial=0.0), 1e-300)
    vectors, nuisance = vectors[:, told], (vectors[:, ~told] ** 2).sum(axis=1)
    rows = (vectors / np.sqrt(values[told])) / units[:, None]
    blocks: NDArray[np.float64] = np.empty((n, 6, 6))
    for i in range(n):
        at = slice(6 * i, 6 * i + 6)
        blocks[i] = rows[at] @ rows[at].T
        untold = nuisance[at] > 1e-6
        blocks[i, untold, :] = np.nan
        blocks[i, :, untold] = np.nan
        blocks[i, untold, untold] = np.inf
    return blocks
