"""Initial volume on voxels and pixels twice as large: the long wavelengths at a sixteenth of the cost of a sweep.

It is reconstructed in pieces of neighbouring slabs, by the process that holds these.  A piece extends beyond its
slabs as far as the rays that cross them, so that no ray lacks a part of its path; only its slabs are used.  Where
steep rays would make that expensive, pieces are larger, up to a single one of all slabs.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from grainmotion._typing import Image
from grainmotion.model.large_arrays import large_empty, large_zeros
from grainmotion.model.progress import counted
from grainmotion.model.scan import Scan
from grainmotion.model.volume import Volume
from grainmotion.preprocessing.binning import binned_scan
from grainmotion.reconstruction.iterate import new_iterate
from grainmotion.reconstruction.ordered_subsets import plain_sart
from grainmotion.reconstruction.settings import ReconstructSettings
from grainmotion.reconstruction.slabs import Layout, Rows
from grainmotion.reconstruction.system import Iterate

COARSENING = 2
"""Edge of a coarse voxel over that of a voxel, and of a coarse pixel over that of a pixel."""
MIN_EXTENT = 24
"""Voxels along the grid's shortest edge and pixels along the panel's from which there is a coarse start."""
MAX_EXTRA_PLANES = 0.25
"""Planes that pieces have in common, over the planes of the grid, at most."""
PLANES_AT_ONCE = 16
"""Planes that are interpolated together: each takes several times its own memory meanwhile."""
SAMPLED_COLUMNS = np.linspace(-0.5, 0.5, 5)
"""Places along a row of pixels whose rays bound the planes that it crosses, over the length of the row."""


@dataclass(frozen=True)
class Piece:
    """Neighbouring slabs that are initialised together.

    Attributes
    ----------
    slabs : range
        Their numbers.
    rows : (int, int)
        The first row of coarse pixels on which they project, and the row after the last.
    planes : (int, int)
        The first plane of coarse voxels that the rays of those rows cross, and the plane after the last.
    """

    slabs: range
    rows: Rows
    planes: tuple[int, int]


def has_coarse_start(shape: tuple[int, ...], panel: tuple[int, int]) -> bool:
    """Whether a grid and a panel are large enough for a coarse start."""
    return min(*shape, *panel) >= MIN_EXTENT


def pieces_of(layout: Layout) -> tuple[Piece, ...]:
    """As many pieces as `MAX_EXTRA_PLANES` allows; they depend on the grid and the views alone."""
    number, planes = len(layout.slabs), halved(layout.shape[0])
    for count in range(number, 1, -1):
        ends = np.round(np.linspace(0, number, count + 1)).astype(int)
        pieces = tuple(_piece(layout, range(a, b)) for a, b in pairwise(ends))
        if sum(end - first for first, end in (p.planes for p in pieces)) <= (1 + MAX_EXTRA_PLANES) * planes:
            return pieces
    return (Piece(range(number), (0, layout.geometry.shape[0] // COARSENING), (0, planes)),)


def started(scan: Scan, grid: Volume, settings: ReconstructSettings) -> Iterate:
    """A volume that starts at the grid's values if any is not zero, else at a coarse reconstruction."""
    iterate = new_iterate(scan, grid, settings)
    if not grid.array.any() and has_coarse_start(grid.shape, scan.geometry.shape):
        iterate.start_from(_starts(scan, Layout.of(grid, scan.geometry, settings)))
    return iterate


def _starts(scan: Scan, layout: Layout) -> Iterator[Image]:
    """Values of the planes of each slab in turn."""
    for piece in counted(pieces_of(layout)):
        array = coarse_start(binned_scan(scan, COARSENING, rows=piece.rows), layout, piece)
        yield from (finer_slab(array, layout, piece, number) for number in piece.slabs)


def coarse_start(rough: Scan, layout: Layout, piece: Piece) -> Image:
    """A sweep of plain SART on the coarse voxels of a piece; ``rough`` are its rows of the binned scan."""
    (first, end), (x, y, z), size = piece.planes, layout.center, layout.voxel_size * COARSENING
    array = large_zeros((end - first, *(halved(n) for n in layout.shape[1:])), np.float32)
    z += size * ((first + end) - halved(layout.shape[0])) / 2
    one_sweep = replace(layout.settings, method="sart", sweeps=1)
    iterate = new_iterate(rough, Volume(array, size, (x, y, z)), one_sweep)
    plain_sart(iterate, len(rough), one_sweep, None)
    return iterate.into_volume().array


def finer_slab(rough: Image, layout: Layout, piece: Piece, number: int) -> Image:
    """Values ``[z, y, x]`` of a slab's planes from those of its piece."""
    first, end = layout.slabs[number]
    planes = large_empty((end - first, *layout.shape[1:]), rough.dtype)
    for low in range(first, end, PLANES_AT_ONCE):
        high = min(low + PLANES_AT_ONCE, end)
        planes[low - first : high - first] = finer(rough, layout.shape, slice(low, high), piece.planes[0])
    return planes


def finer(array: Image, shape: tuple[int, ...], planes: slice = slice(None), first: int = 0) -> Image:
    """Trilinear interpolation at the centres of voxels half as large, ``shape`` of them around the same centre.

    ``planes`` selects planes along z; ``array`` may hold the coarse planes from ``first`` on alone.
    """
    for axis, count in enumerate(shape):
        lines = np.moveaxis(array, axis, 0)
        # with an odd number of fine voxels, the middle one lies on the edge or at the centre of a coarse one
        at = (np.arange(count) - (count - 1) / 2) / COARSENING + (halved(count) - 1) / 2
        at = at[planes] - first if axis == 0 else at
        low = np.clip(np.floor(at).astype(int), 0, max(len(lines) - 2, 0))
        weight = np.clip(at - low, 0, 1).astype(array.dtype).reshape(-1, 1, 1)
        high = np.minimum(low + 1, len(lines) - 1)
        array = np.moveaxis((1 - weight) * lines[low] + weight * lines[high], 0, axis)
    return np.ascontiguousarray(array)


def halved(count: int) -> int:
    """Coarse voxels along an edge of ``count`` voxels."""
    return -(-count // COARSENING)


def _piece(layout: Layout, slabs: range) -> Piece:
    """Slabs, the rows on which they project, and the planes that the rays of these cross."""
    footprints, rows = [layout.footprints[k] for k in slabs], layout.geometry.shape[0] // COARSENING
    first = min(min(row for row, _ in footprints) // COARSENING, rows - 1)  # the last row of an odd panel is left out
    end = max(first + 1, min(halved(max(row for _, row in footprints)), rows))
    lowest, highest = _crossed(layout, (COARSENING * first, COARSENING * end))
    lowest, highest = min(lowest, layout.slabs[slabs[0]][0]), max(highest, layout.slabs[slabs[-1]][1])
    whole = halved(layout.shape[0])
    edge = (whole - layout.shape[0] / COARSENING) / 2  # coarse voxels extend beyond an odd number
    low = np.floor(lowest / COARSENING + edge) - 1  # one more plane on each side, to interpolate
    high = np.ceil(highest / COARSENING + edge) + 1
    return Piece(slabs, (first, end), (int(max(low, 0)), int(min(high, whole))))


def _crossed(layout: Layout, rows: Rows) -> tuple[float, float]:
    """Lowest and highest edge of the planes that the rays of some rows cross, in planes from the grid's first edge."""
    geometry = layout.geometry
    s, d, u, v = (part[:, None] for part in (geometry.source, geometry.detector, geometry.u, geometry.v))
    height, width = geometry.shape
    down, right = np.meshgrid(np.array(rows) - height / 2, SAMPLED_COLUMNS * width, indexing="ij")
    pixels = d + right.reshape(-1, 1) * u + down.reshape(-1, 1) * v
    start, ray = (s, pixels - s) if geometry.beam == "cone" else (pixels, np.broadcast_to(s, pixels.shape))
    place, direction = start[..., :2] - layout.center[:2], ray[..., :2]  # in the horizontal plane
    with np.errstate(divide="ignore", invalid="ignore"):
        nearest = -(place * direction).sum(-1) / (direction**2).sum(-1)  # point of the ray nearest to the axis
        half_chord = layout.radius / np.linalg.norm(direction, axis=-1)
        ends = nearest + half_chord * np.array([-1, 1]).reshape(2, 1, 1)  # where it enters and leaves the cylinder
        heights = start[..., 2] - layout.center[2] + ends * ray[..., 2]
    if not np.isfinite(heights).all():  # a ray along the axis
        return 0.0, float(layout.shape[0])
    planes = heights / layout.voxel_size + layout.shape[0] / 2
    return float(np.clip(planes.min(), 0, layout.shape[0])), float(np.clip(planes.max(), 0, layout.shape[0]))
