"""Ellipsoids fitted to what radiographs hold beside the grains: the size and place of grains without a reference.

Few views determine hardly more of a grain than its place and an ellipsoid.  Its line integrals are known exactly: with
x = c + L s for |s| ≤ 1, the chord of a ray is that of a unit ball along the ray in the coordinates s.  All ellipsoids
are fitted together, as the shadows of several may overlap.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage, sparse

from grainmotion._typing import Float, Image
from grainmotion.model.geometry import Geometry
from grainmotion.model.progress import reached

FILTER_PIXELS = 1.0
"""Width of the filter on residuals and chords: the shadow of an ellipsoid has a steep edge."""
WINDOW_RADII = 2.0
"""Half the width of the part of a radiograph to which an ellipsoid is fitted, over its largest radius."""
ITERATIONS, SETTLED = 8, 1e-3
"""Steps at most, and the change of the cost that ends them."""
DIFFERENCE = 1e-3
"""Step of numeric derivatives, in radii and in the logarithm of the attenuation."""
PLACE_SPREAD = 1.0
"""Standard deviation that is expected of a place, in usual radii."""
MODEL_ERROR, MODEL_ERROR_RADII = 0.15, 0.5
"""Error of an ellipsoid's line integrals as a share of those of a grain, and how far it is correlated, in radii."""
AXIS_RANGE, ATTENUATION_RANGE = (0.25, 2.5), (0.4, 2.5)
"""Half axes over the usual radius, and attenuation over the usual one."""
UNKNOWNS = 10
"""Of an ellipsoid: its place, its half axes as a symmetric matrix, and the logarithm of its attenuation."""
_PAIRS = ((0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1))


@dataclass(frozen=True)
class Usual:
    """What is expected of a grain: radius (mm), attenuation (1/mm) and the standard deviation of both, as a share."""

    radius: float
    attenuation: float
    spread: float = 0.3


@dataclass(frozen=True, eq=False)
class Ellipsoid:
    """An ellipsoid: ``center (3,)`` and symmetric ``axes (3, 3)`` L, mm, and its ``attenuation``, 1/mm.

    ``covariance (10, 10)`` is of the centre (mm), of L (xx, yy, zz, yz, xz, xy; mm) and of the logarithm of the
    attenuation; NaN before a fit.
    """

    center: Float
    axes: Float
    attenuation: float
    covariance: Float

    @classmethod
    def ball(cls, center: Float, radius: float, attenuation: float) -> Ellipsoid:
        """A ball."""
        unknown = np.full((UNKNOWNS, UNKNOWNS), np.nan)
        return cls(np.asarray(center, dtype=float), radius * np.eye(3), attenuation, unknown)

    @property
    def radius(self) -> float:
        """Radius of the ball of the same volume, mm."""
        return float(np.cbrt(abs(np.linalg.det(self.axes))))

    @property
    def mass(self) -> float:
        """Attenuation times volume, mm²."""
        return 4 / 3 * np.pi * self.radius**3 * self.attenuation

    @property
    def center_sd(self) -> Float:
        """Standard deviations of the centre ``(3,)``, mm."""
        return np.asarray(np.sqrt(np.diagonal(self.covariance)[:3]))

    @property
    def radius_sd(self) -> float:
        """Standard deviation of the radius, mm."""
        inverse = np.linalg.inv(self.axes)
        slope = np.array([(1 if i == j else 2) * inverse[i, j] for i, j in _PAIRS]) * self.radius / 3
        return float(np.sqrt(slope @ self.covariance[3:9, 3:9] @ slope))

    @property
    def reach(self) -> float:
        """Largest half axis, mm."""
        return float(np.abs(np.linalg.eigvalsh(self.axes)).max())

    def line_integrals(self, source: Float, rays: Float) -> Float:
        """Along rays ``(..., 3)`` (unit vectors) from ``source (3,)`` or ``(..., 3)``, mm."""
        inverse = np.linalg.inv(self.axes)
        start, way = (source - self.center) @ inverse, rays @ inverse
        squares = (way * way).sum(axis=-1)
        along = (start * way).sum(axis=-1)
        inside = along**2 - squares * ((start * start).sum(axis=-1) - 1)
        return np.asarray(self.attenuation * 2 * np.sqrt(np.maximum(inside, 0)) / squares)

    def moved(self, step: Float, usual: Usual) -> Ellipsoid:
        """After a step of its ten unknowns, within the ranges about what is usual."""
        axes = self.axes + _symmetric(step[3:9])
        values, vectors = np.linalg.eigh(axes)
        values = np.clip(values, AXIS_RANGE[0] * usual.radius, AXIS_RANGE[1] * usual.radius)
        share = np.log(self.attenuation / usual.attenuation) + step[9]
        attenuation = usual.attenuation * float(np.exp(np.clip(share, *np.log(ATTENUATION_RANGE))))
        return Ellipsoid(self.center + step[:3], (vectors * values) @ vectors.T, attenuation, self.covariance)


def _symmetric(values: Float) -> Float:
    """The symmetric matrix of xx, yy, zz, yz, xz, xy."""
    out = np.zeros((3, 3))
    for value, (i, j) in zip(values, _PAIRS, strict=True):
        out[i, j] = out[j, i] = value
    return out


def _values(matrix: Float) -> Float:
    return np.array([matrix[i, j] for i, j in _PAIRS])


@dataclass(frozen=True, eq=False)
class _Window:
    """The part of one radiograph that an ellipsoid may reach: where it is, and its rays."""

    view: int
    rows: slice
    columns: slice
    sources: Float
    rays: Float

    def image(self, ellipsoid: Ellipsoid) -> Float:
        """The ellipsoid's filtered line integrals there."""
        images = ellipsoid.line_integrals(self.sources, self.rays)
        return np.asarray(ndimage.gaussian_filter(images, FILTER_PIXELS))


def fit_ellipsoids(
    residual: Image, geometry: Geometry, ellipsoids: Sequence[Ellipsoid], usual: Usual, valid: Image
) -> list[Ellipsoid]:
    """Fit ellipsoids to residual radiographs ``(views, rows, columns)`` that hold them and no grain.

    ``usual`` is what is expected of them; ``valid`` is 1 for pixels that count, else 0.
    """
    if not ellipsoids:
        return []
    good = np.stack([ndimage.gaussian_filter(v.astype(float), FILTER_PIXELS) for v in valid])
    images = np.stack([ndimage.gaussian_filter(r * v, FILTER_PIXELS) for r, v in zip(residual, valid, strict=True)])
    images = np.where(valid > 0, images / np.maximum(good, 1e-3), 0.0).astype(float)
    windows = [_windows(geometry, e) for e in ellipsoids]
    radius = usual.radius
    variance = model_variance(geometry, usual, np.mean([e.center for e in ellipsoids], axis=0))
    spread = np.array([PLACE_SPREAD * radius] * 3 + [usual.spread * radius] * 6 + [usual.spread])
    centers, damping, cost = [e.center for e in ellipsoids], 1e-3, np.inf
    now = list(ellipsoids)
    state = _linearized(images, valid, windows, now, usual)
    for _ in range(ITERATIONS):
        gaps = [_from_usual(e, c, usual) for e, c in zip(now, centers, strict=True)]
        prior = np.tile(1 / spread**2, len(now))
        cost = state[0] / variance + float((prior * np.concatenate(gaps) ** 2).sum())
        hessian = state[2] / variance + np.diag(prior)
        gradient = state[1] / variance - prior * np.concatenate(gaps)
        better = False
        for _ in range(4):
            reached(0.0)  # a dozen ellipsoids in large radiographs take a second
            step: Float = np.linalg.solve(hessian + damping * np.diag(np.diag(hessian)), gradient).astype(float)
            trial = [e.moved(s, usual) for e, s in zip(now, step.reshape(-1, UNKNOWNS), strict=True)]
            ahead = _linearized(images, valid, windows, trial, usual)
            gaps = [_from_usual(e, c, usual) for e, c in zip(trial, centers, strict=True)]
            new_cost = ahead[0] / variance + float((prior * np.concatenate(gaps) ** 2).sum())
            better = new_cost < cost
            damping = max(damping / 5, 1e-4) if better else damping * 10
            if better:
                break
        if not better:
            break
        now, state = trial, ahead
        if cost - new_cost < SETTLED * cost:
            break
    covariance: Float = np.linalg.inv(state[2] / variance + np.diag(np.tile(1 / spread**2, len(now)))).astype(float)
    own = [slice(k * UNKNOWNS, (k + 1) * UNKNOWNS) for k in range(len(now))]
    return [
        Ellipsoid(e.center, e.axes, e.attenuation, covariance[rows, rows]) for e, rows in zip(now, own, strict=True)
    ]


def model_variance(geometry: Geometry, usual: Usual, center: Float) -> float:
    """Variance of a pixel times the pixels over which it is correlated, as an ellipsoid is not a grain's shape."""
    area = np.pi * (MODEL_ERROR_RADII * usual.radius / geometry.pixel_at(center)) ** 2
    return float((MODEL_ERROR * 4 / 3 * usual.radius * usual.attenuation) ** 2 * max(area, 1.0))


def unlikeliness(ellipsoid: Ellipsoid, usual: Usual) -> float:
    """Squared departures of shape and attenuation from what is usual, over their variances."""
    gaps = _from_usual(ellipsoid, ellipsoid.center, usual)
    gaps[3:9] /= usual.radius
    return float((gaps**2).sum()) / usual.spread**2


def ellipsoid_images(ellipsoids: Sequence[Ellipsoid], geometry: Geometry) -> Image:
    """Line integrals of ellipsoids, ``(views, rows, columns)``."""
    out = np.zeros((len(geometry), *geometry.shape))
    for ellipsoid in ellipsoids:
        for window in _windows(geometry, ellipsoid):
            box = window.view, window.rows, window.columns
            out[box] += ellipsoid.line_integrals(window.sources, window.rays)
    return out


def _from_usual(ellipsoid: Ellipsoid, center: Float, usual: Usual) -> Float:
    """Departure of the unknowns from what is expected."""
    shape = _values(ellipsoid.axes - usual.radius * np.eye(3))
    return np.concatenate([ellipsoid.center - center, shape, [np.log(ellipsoid.attenuation / usual.attenuation)]])


def _windows(geometry: Geometry, ellipsoid: Ellipsoid) -> list[_Window]:
    """The window of each view that sees the ellipsoid."""
    half = int(np.ceil(WINDOW_RADII * ellipsoid.reach / geometry.pixel_at(ellipsoid.center))) + 3
    out = []
    for view, (middle,) in enumerate(geometry.project_points(ellipsoid.center[None])):
        if not np.isfinite(middle).all():
            continue
        low = [max(int(m) - half, 0) for m in middle]
        high = [min(int(m) + half + 1, n) for m, n in zip(middle, geometry.shape, strict=True)]
        if low[0] >= high[0] or low[1] >= high[1]:
            continue
        rows, columns = slice(low[0], high[0]), slice(low[1], high[1])
        pixels = geometry.pixel_positions(view)[rows, columns]
        if geometry.beam == "cone":
            sources = geometry.source[view]
            rays = pixels - sources
        else:
            sources, rays = pixels, np.broadcast_to(geometry.source[view], pixels.shape)
        rays = rays / np.linalg.norm(rays, axis=-1, keepdims=True)
        out.append(_Window(view, rows, columns, sources, rays))
    return out


def _linearized(
    images: Float, valid: Image, windows: list[list[_Window]], ellipsoids: list[Ellipsoid], usual: Usual
) -> tuple[float, Float, Float]:
    """‖r‖², its half negative gradient and JᵀJ of all unknowns."""
    left, numbers = images.copy(), np.arange(images.size).reshape(images.shape)
    seen = np.zeros(images.shape, dtype=bool)
    values: list[Float] = []
    rows: list[NDArray[np.int64]] = []
    columns: list[NDArray[np.int64]] = []
    for k, (ellipsoid, own) in enumerate(zip(ellipsoids, windows, strict=True)):
        for window in own:
            box = window.view, window.rows, window.columns
            image = window.image(ellipsoid) * (valid[box] > 0)
            left[box] -= image
            seen[box] = True
            for j in range(UNKNOWNS):
                step = np.zeros(UNKNOWNS)
                step[j] = DIFFERENCE * (usual.radius if j < 9 else 1.0)
                ahead = _stepped(ellipsoid, step)
                values.append(((window.image(ahead) * (valid[box] > 0) - image) / step[j]).ravel())
                rows.append(numbers[box].ravel())
                columns.append(np.full(image.size, k * UNKNOWNS + j))
    shape = (images.size, len(ellipsoids) * UNKNOWNS)
    jacobian = sparse.csr_array(
        (np.concatenate(values), (np.concatenate(rows), np.concatenate(columns))), shape=shape
    ).tocsc()
    left = np.where(seen, left, 0.0)
    gradient = np.asarray(jacobian.T @ left.ravel(), dtype=float)
    return float((left**2).sum()), gradient, np.asarray((jacobian.T @ jacobian).toarray())


def _stepped(ellipsoid: Ellipsoid, step: Float) -> Ellipsoid:
    """After a small step, without bounds."""
    attenuation = ellipsoid.attenuation * float(np.exp(step[9]))
    return Ellipsoid(
        ellipsoid.center + step[:3], ellipsoid.axes + _symmetric(step[3:9]), attenuation, ellipsoid.covariance
    )
