"""The grid on which a scan is reconstructed: the one that was asked for, grown until it holds all rays.

Attenuation on a ray that leaves the grid would be crammed into what the ray crosses of it.  Two cases are seen from
the radiographs:

- the sample goes on above or below the panel.  In a cone beam the rays of the outer rows leave the grid within the
  sample: a few layers more hold them;
- the sample is wider than the panel (local tomography).  Its outline follows from the radiographs as that of a
  cylinder, p(s)² = 4 μ² (R² − s²) for a ray at the distance s from its axis (Hsieh et al., Med. Phys. 31, 2004, 2385),
  or from the user, and the grid is grown to hold it.

The voxels that were asked for keep their places.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from grainmotion._typing import Float, Image, Progress
from grainmotion.errors import InputError
from grainmotion.model.field_of_view import FieldOfView, evenly_spaced
from grainmotion.model.geometry import Geometry
from grainmotion.model.scan import Scan
from grainmotion.model.volume import Volume
from grainmotion.reconstruction.settings import ReconstructSettings

GROWTH_VIEWS = 32
"""Views, evenly spaced, whose radiographs decide whether a grid is grown."""
LIT_BLOCK_LEVEL, MIN_LIT_SHARE = 0.08, 0.03
"""Of the largest line integral, from which some pixels together show the sample; share of the pixels of rays that leave
the grid, or of a panel's outer row, that show it where the sample goes on."""
BLOCK_COLUMNS, BLOCK_ROWS = 16, 16
"""Pixels that are averaged, so that noise does not look like a sample."""
MIN_LIT_BLOCKS = 0.01
"""Share of the blocks at one distance from the axis that show the sample where it reaches as far."""
EDGE_PIXELS = 2.0
"""Pixels from the panel's edge up to which a sample reaches that goes on beyond it."""
OUTLINE_MARGIN = 1.03
"""Times an outline that was estimated from truncated radiographs: 2 % too small for a packing in a cylinder, whose edge
is looser.  ε grows by a twentieth for an outline 5 % too large."""
MAX_OUTLINE, UNKNOWN_OUTLINE = 1.8, 1.2
"""Largest outline to believe over the panel's half width at the axis, and the one to take where none can be told."""
MAX_LAYERS_SHARE, MIN_MAX_LAYERS = 0.5, 8
"""Layers by which a grid grows above and below at most, over its own; never limited to fewer than the second."""
GROWN_REMEDY = 'set volume.outline to the sample\'s radius if that is known, or to "grid" to keep the grid'
"""What to do about a grid that was grown."""
RAY_COLUMNS = 17
"""Places along a row of pixels whose rays bound the layers that it crosses."""


@dataclass(frozen=True, eq=False)
class FittedGrid:
    """The grid that is used, what the scan saw of it, and sentences on how it differs from the one asked for."""

    grid: Volume
    settings: ReconstructSettings
    field: FieldOfView
    notes: tuple[str, ...] = ()

    def report(self, progress: Progress | None) -> None:
        """Report that the grid was grown, if it was."""
        if progress is not None:
            for note in self.notes:
                progress(note, 0, 1)

    def seen(self, volume: Volume) -> Volume:
        """A volume on the grid, with what of it the scan saw."""
        return replace(volume, field=self.field)


def growth_views(views: int) -> NDArray[np.int64]:
    """The views of a scan whose radiographs `fitted_grid` wants."""
    return evenly_spaced(views, GROWTH_VIEWS)


def fitted_grid(some: Scan, geometry: Geometry, grid: Volume, settings: ReconstructSettings) -> FittedGrid:
    """The grid for a scan of ``geometry``, grown from ``grid`` if the settings allow; ``some`` are its `growth_views`.

    With ``settings.outline = "grid"`` the grid stays; with a radius (mm) it is grown to hold that.
    """
    center, size = np.array(grid.center), grid.voxel_size
    own = min(grid.shape[1:]) / 2 * size
    rays = _MiddleRays.of(some.geometry, center)
    _check_seen(grid, rays, own)
    lit = _lit_radius(some, rays, size)
    beside = lit >= rays.reach - EDGE_PIXELS * some.geometry.pixel_at(grid.center)
    radius = min(lit + size, own)
    if settings.outline not in ("auto", "grid"):
        radius = float(settings.outline)
        settings = replace(settings, outline=radius)
    elif beside and own >= rays.reach + 2 * size:  # the user made room for it
        radius = own
    elif beside and settings.outline == "auto":
        radius = _outline(some, rays) * OUTLINE_MARGIN + size
    ends = _lit_ends(some)
    layers = sides = 0, 0
    if settings.outline != "grid":
        out = int(np.ceil(max(radius - own, 0) / size - 1e-6))
        sides = (out, out)
        layers = _layers(some, geometry, grid, radius) if grid.shape[0] > 1 else (0, 0)
        if sides != (0, 0) and beside:
            settings = replace(settings, outline=radius)
    beside = beside and radius > rays.reach
    field = FieldOfView(geometry, max(radius, size), (float(center[0]), float(center[1])), ends[1], ends[0], beside)
    notes: tuple[str, ...] = ()
    if layers != (0, 0) or sides != (0, 0):
        notes = (_sentence(grid, layers, sides[0], radius, beside),)
        grid = _grown(grid, layers, sides[0])
    return FittedGrid(grid, settings, field, notes)


def _check_seen(grid: Volume, rays: _MiddleRays, own: float) -> None:
    """Refuse a grid that lies beside the rays of most views: it would grow over all that is between."""
    seen = (rays.distances.min(axis=1) < own) & (rays.distances.max(axis=1) > -own)
    if seen.mean() <= 0.5:
        fact = f"a grid about {grid.center} mm lies beside the panel in {1 - seen.mean():.0%} of the views"
        raise InputError(
            "volume.center", fact, "give its centre and its voxel size in mm; the rotation axis is at x = y = 0"
        )


def _sentence(grid: Volume, layers: tuple[int, int], sides: int, radius: float, beside: bool) -> str:
    """How a grid was grown, and why."""
    nz, ny, nx = grid.shape
    new = [nz + sum(layers), ny + 2 * sides, nx + 2 * sides]
    parts = []
    if sides:
        wider = "the sample is wider than the panel: " if beside else ""
        parts.append(f"{wider}its outline has a radius of {radius:.4g} mm")
    if any(layers):
        parts.append("rays through the sample leave the grid above or below")
    return f"the grid of {[nz, ny, nx]} voxels (z, y, x) was grown to {new}, which hold all rays: {'; '.join(parts)}"


def _grown(grid: Volume, layers: tuple[int, int], sides: int) -> Volume:
    """The grid with layers of zeros below and above, and on all sides; its own voxels keep their places."""
    array = np.pad(grid.array, (layers, (sides, sides), (sides, sides)))
    x, y, z = grid.center
    return Volume(array, grid.voxel_size, (x, y, z + grid.voxel_size * (layers[1] - layers[0]) / 2))


@dataclass(frozen=True, eq=False)
class _MiddleRays:
    """Rays of the middle row: signed distance from the upright axis ``(views, columns)``, and its direction."""

    distances: Float
    normals: Float  # (views, columns, 2), horizontal unit vectors along which the distances count
    reach: float  # the largest distance from the axis

    @classmethod
    def of(cls, geometry: Geometry, center: Float) -> _MiddleRays:
        columns = np.arange(geometry.shape[1]) - (geometry.shape[1] - 1) / 2
        start, ray = _rays(geometry, np.zeros(1), columns)
        across = np.stack([ray[..., 1], -ray[..., 0]], -1)[:, 0]
        across /= np.maximum(np.linalg.norm(across, axis=-1, keepdims=True), 1e-300)
        distances = ((start[:, 0, :, :2] - center[:2]) * across).sum(-1)
        edges = np.abs(distances[:, [0, -1]]).max(axis=1)
        return cls(distances, across, float(np.median(edges)))


def _rays(geometry: Geometry, rows: Image, columns: Image) -> tuple[Float, Float]:
    """A point and the direction ``(views, rows, columns, 3)`` of rays, by rows and columns from the panel's centre."""
    s, d, u, v = (part[:, None, None] for part in (geometry.source, geometry.detector, geometry.u, geometry.v))
    pixels = d + columns[None, None, :, None] * u + rows[None, :, None, None] * v
    if geometry.beam == "cone":
        return np.broadcast_to(s, pixels.shape), pixels - s
    return pixels, np.broadcast_to(s, pixels.shape)


def _heights(geometry: Geometry, rows: Image, columns: Image, center: Float, radius: float) -> tuple[Float, Float]:
    """Lowest and highest z, over the grid's centre, of rays within an upright cylinder ``(views, rows, columns)``.

    NaN for a ray that misses it, or runs along its axis.
    """
    start, ray = _rays(geometry, rows, columns)
    place, direction = start[..., :2] - center[:2], ray[..., :2]
    with np.errstate(divide="ignore", invalid="ignore"):
        squared = (direction**2).sum(-1)
        nearest = -(place * direction).sum(-1) / squared
        beside = ((place + nearest[..., None] * direction) ** 2).sum(-1)
        half = np.sqrt(radius**2 - beside) / np.sqrt(squared)
        ends = [start[..., 2] - center[2] + (nearest + side * half) * ray[..., 2] for side in (-1, 1)]
    return np.minimum(*ends), np.maximum(*ends)


def _layers(some: Scan, geometry: Geometry, grid: Volume, radius: float) -> tuple[int, int]:
    """Layers to add below and above, so that the grid holds every ray that crosses it within the sample's outline."""
    center, size = np.array(grid.center), grid.voxel_size
    half = grid.shape[0] * size / 2
    leaves = _lit_rays_leave(some, center, radius, half)
    if not any(leaves):
        return 0, 0
    views = geometry[evenly_spaced(len(geometry), 2 * GROWTH_VIEWS)]
    rows = np.arange(geometry.shape[0]) - (geometry.shape[0] - 1) / 2
    columns = np.linspace(-0.5, 0.5, RAY_COLUMNS) * geometry.shape[1]
    low, high = _heights(views, rows, columns, center, radius)
    crossing = (low < half) & (high > -half)
    most = max(int(MAX_LAYERS_SHARE * grid.shape[0]), MIN_MAX_LAYERS)
    found = []
    for leaving, furthest in zip(leaves, (-low, high), strict=True):
        beyond = float(furthest[crossing].max(initial=half)) - half
        found.append(min(int(np.ceil(beyond / size)) + 1, most) if leaving else 0)
    return found[0], found[1]


def _lit_rays_leave(some: Scan, center: Float, radius: float, half: float) -> tuple[bool, bool]:
    """Whether rays that show the sample leave the grid (of half the height ``half``) through its base, and its top."""
    width = min(BLOCK_COLUMNS, max(some.geometry.shape[1] // 4, 1))
    blocks = _blocks(_good(some), width, axis=2)
    level = LIT_BLOCK_LEVEL * float(np.percentile(blocks, 99))
    rows = np.arange(some.geometry.shape[0]) - (some.geometry.shape[0] - 1) / 2
    columns = (np.arange(blocks.shape[2]) + 0.5) * width - some.geometry.shape[1] / 2
    counts = np.zeros((2, 2))  # base and top; all rays that leave, and those of them that show the sample
    for view, image in enumerate(blocks):
        low, high = _heights(some.geometry[view], rows, columns, center, radius)
        for side, leaving in enumerate([(low < -half) & (high > -half), (high > half) & (low < half)]):
            counts[side] += leaving.sum(), (leaving[0] & (image > level)).sum()
    shares = counts[:, 1] / np.maximum(counts[:, 0], 1)
    return bool(shares[0] > MIN_LIT_SHARE), bool(shares[1] > MIN_LIT_SHARE)


def _lit_ends(some: Scan) -> tuple[bool, bool]:
    """Whether the sample shows on the panel's lowest row, and on its highest."""
    width = min(BLOCK_COLUMNS, max(some.geometry.shape[1] // 4, 1))
    blocks = _blocks(_good(some), width, axis=2)
    if blocks.shape[1] == 1:
        return False, False
    level = LIT_BLOCK_LEVEL * float(np.percentile(blocks, 99))
    upright = some.geometry.v[:, 2] >= 0
    first, last = (float((blocks[upright][:, k] > level).mean()) if upright.any() else 0.0 for k in (0, -1))
    if not upright.all():
        others = [float((blocks[~upright][:, k] > level).mean()) for k in (-1, 0)]
        first, last = max(first, others[0]), max(last, others[1])
    return first > MIN_LIT_SHARE, last > MIN_LIT_SHARE


def _good(some: Scan) -> Image:
    """Radiographs, 0 where a pixel carries no weight."""
    return some.line_integrals if some.valid is None else np.where(some.valid, some.line_integrals, 0)


def _blocks(images: Image, width: int, axis: int) -> Image:
    """Means of ``width`` neighbours along an axis; what is left over at its end is left out."""
    count = images.shape[axis] // width
    images = np.moveaxis(images, axis, -1)[..., : count * width]
    return np.moveaxis(images.reshape(*images.shape[:-1], count, width).mean(axis=-1), -1, axis)


def _lit_radius(some: Scan, rays: _MiddleRays, size: float) -> float:
    """Largest distance from the axis at which the radiographs show the sample, mm."""
    height = min(BLOCK_ROWS, some.geometry.shape[0])
    blocks = _blocks(_good(some), height, axis=1)
    level = LIT_BLOCK_LEVEL * float(np.percentile(blocks, 99))
    rings = np.floor(np.abs(rays.distances) / size).astype(int)
    count = np.bincount(rings.ravel(), minlength=1).astype(float)
    lit = np.bincount(rings.ravel(), weights=(blocks > level).mean(axis=1).ravel())
    reached = np.flatnonzero(lit > MIN_LIT_BLOCKS * count)
    return float(min((reached.max(initial=0) + 1) * size, rays.reach))


def _outline(some: Scan, rays: _MiddleRays) -> float:
    """Radius about the grid's axis of the cylinder whose radiographs fit best beyond half of the panel's reach, mm.

    p² = q (R² − (s − c·n)²) is linear in q, q c and the products of c's components, with the cylinder's axis at c.
    """
    s, n = rays.distances, rays.normals
    good = np.ones(some.line_integrals.shape, bool) if some.valid is None else some.valid
    p = _good(some).sum(axis=1, dtype=float) / np.maximum(good.sum(axis=1), 1)
    outer = (np.abs(s) > rays.reach / 2) & good.any(axis=1)
    cos2, sin2 = n[..., 0] ** 2 - n[..., 1] ** 2, 2 * n[..., 0] * n[..., 1]
    terms = np.stack([np.ones_like(s), -(s**2), s * n[..., 0], s * n[..., 1], cos2, sin2], -1)
    a, q, bx, by, _, _ = np.linalg.lstsq(terms[outer], p[outer] ** 2, rcond=None)[0]
    if q <= 0:
        return UNKNOWN_OUTLINE * rays.reach
    away = float(np.hypot(bx, by)) / (2 * q)
    radius = float(np.sqrt(max(a / q + away**2 / 2, 0.0))) + away
    return float(np.clip(radius, rays.reach, MAX_OUTLINE * rays.reach))
