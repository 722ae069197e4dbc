"""A start on voxels twice as large, seen by pixels twice as large: the long wavelengths for a sixteenth of a sweep.

It is made in pieces of neighbouring slabs, by whoever holds these.  A piece reaches as far beyond its slabs as the
rays do that cross them, so that no ray of it misses a part of its path; what is found there is not used.  Where rays
are so steep that this would cost much, pieces are larger; one of all slabs is the whole.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from grainmotion._typing import Image
from grainmotion.model.scan import Scan
from grainmotion.model.volume import Volume
from grainmotion.preprocessing.binning import binned_scan
from grainmotion.reconstruction.iterate import new_iterate
from grainmotion.reconstruction.ordered_subsets import plain_sart
from grainmotion.reconstruction.settings import ReconstructSettings
from grainmotion.reconstruction.slabs import Layout, Rows
from grainmotion.reconstruction.system import Iterate

COARSER = 2
"""Edge of a coarse voxel, fine voxels; of a coarse pixel, fine pixels."""
SMALLEST = 24
"""Voxels along the grid's shortest edge and pixels along the panel's, below which there is no coarse start."""
EXTRA = 0.25
"""Planes of all pieces beyond those of the whole, over these, at most."""
ACROSS = np.linspace(-0.5, 0.5, 5)
"""Where along a row of pixels its rays are looked at, over its length."""


@dataclass(frozen=True)
class Piece:
    """Neighbouring slabs that are started together.

    Attributes
    ----------
    slabs : range
        Their numbers.
    rows : (int, int)
        The first row of coarse pixels that see them, and the row after the last.
    planes : (int, int)
        The first plane of coarse voxels that those rows see, and the plane after the last.
    """

    slabs: range
    rows: Rows
    planes: tuple[int, int]


def has_coarse_start(shape: tuple[int, ...], panel: tuple[int, int]) -> bool:
    """Whether a grid of zeros of some shape and a panel are large enough for a coarse start."""
    return min(*shape, *panel) >= SMALLEST


def pieces_of(layout: Layout) -> tuple[Piece, ...]:
    """As many pieces as go without much work twice; they follow from the grid and the views alone."""
    number, planes = len(layout.slabs), halved(layout.shape[0])
    for count in range(number, 1, -1):
        ends = np.round(np.linspace(0, number, count + 1)).astype(int)
        found = tuple(_piece(layout, range(a, b)) for a, b in pairwise(ends))
        if sum(end - first for first, end in (p.planes for p in found)) <= (1 + EXTRA) * planes:
            return found
    return (Piece(range(number), (0, layout.geometry.shape[0] // COARSER), (0, planes)),)


def started(scan: Scan, grid: Volume, settings: ReconstructSettings) -> Iterate:
    """An image from the grid's own values if it has any, or from a coarse start."""
    iterate = new_iterate(scan, grid, settings)
    if not grid.array.any() and has_coarse_start(grid.shape, scan.geometry.shape):
        iterate.start_from(_starts(scan, Layout.of(grid, scan.geometry, settings)))
    return iterate


def _starts(scan: Scan, layout: Layout) -> Iterator[Image]:
    """Of each slab in turn the values of its planes."""
    for piece in pieces_of(layout):
        array = coarse_start(binned_scan(scan, COARSER, rows=piece.rows), layout, piece)
        yield from (finer_slab(array, layout, piece, number) for number in piece.slabs)


def coarse_start(rough: Scan, layout: Layout, piece: Piece) -> Image:
    """A sweep of plain SART on the coarse voxels of a piece; ``rough`` are its rows of the scan binned by as much."""
    (first, end), (x, y, z), size = piece.planes, layout.center, layout.voxel_size * COARSER
    array = np.zeros((end - first, *(halved(n) for n in layout.shape[1:])), np.float32)
    z += size * ((first + end) - halved(layout.shape[0])) / 2
    once = replace(layout.settings, method="sart", sweeps=1)
    iterate = new_iterate(rough, Volume(array, size, (x, y, z)), once)
    plain_sart(iterate, len(rough), once, None)
    return iterate.volume().array


def finer_slab(rough: Image, layout: Layout, piece: Piece, number: int) -> Image:
    """Values ``[z, y, x]`` of a slab's planes from those of its piece."""
    return finer(rough, layout.shape, slice(*layout.slabs[number]), piece.planes[0])


def finer(array: Image, shape: tuple[int, ...], planes: slice = slice(None), first: int = 0) -> Image:
    """Trilinear values at the middles of voxels half as large, ``shape`` of them around the same middle.

    ``planes`` picks some of them along z; ``array`` may be the coarse planes from ``first`` on alone.
    """
    for axis, count in enumerate(shape):
        lines = np.moveaxis(array, axis, 0)
        # of an odd number of fine voxels the middle one lies on a coarse one's edge or middle
        at = (np.arange(count) - (count - 1) / 2) / COARSER + (halved(count) - 1) / 2
        at = at[planes] - first if axis == 0 else at
        low = np.clip(np.floor(at).astype(int), 0, max(len(lines) - 2, 0))
        weight = np.clip(at - low, 0, 1).astype(array.dtype).reshape(-1, 1, 1)
        high = np.minimum(low + 1, len(lines) - 1)
        array = np.moveaxis((1 - weight) * lines[low] + weight * lines[high], 0, axis)
    return np.ascontiguousarray(array)


def halved(count: int) -> int:
    """Coarse voxels along an edge of so many."""
    return -(-count // COARSER)


def _piece(layout: Layout, slabs: range) -> Piece:
    """Slabs, the rows that see them, and the planes that these see."""
    shaded, rows = [layout.shaded[k] for k in slabs], layout.geometry.shape[0] // COARSER
    first = min(min(row for row, _ in shaded) // COARSER, rows - 1)  # an odd panel's last row is of no coarse one
    end = max(first + 1, min(halved(max(row for _, row in shaded)), rows))
    lowest, highest = _crossed(layout, (COARSER * first, COARSER * end))
    lowest, highest = min(lowest, layout.slabs[slabs[0]][0]), max(highest, layout.slabs[slabs[-1]][1])
    whole = halved(layout.shape[0])
    edge = (whole - layout.shape[0] / COARSER) / 2  # of an odd number the coarse voxels reach beyond the fine ones
    low, high = np.floor(lowest / COARSER + edge) - 1, np.ceil(highest / COARSER + edge) + 1  # and one to interpolate
    return Piece(slabs, (first, end), (int(max(low, 0)), int(min(high, whole))))


def _crossed(layout: Layout, rows: Rows) -> tuple[float, float]:
    """Lowest and highest edge of what the rays of some rows cross, planes from the grid's first edge on."""
    geometry = layout.geometry
    s, d, u, v = (part[:, None] for part in (geometry.source, geometry.detector, geometry.u, geometry.v))
    down, right = np.meshgrid(np.array(rows) - geometry.shape[0] / 2, ACROSS * geometry.shape[1], indexing="ij")
    pixels = d + right.reshape(-1, 1) * u + down.reshape(-1, 1) * v
    start, ray = (s, pixels - s) if geometry.beam == "cone" else (pixels, np.broadcast_to(s, pixels.shape))
    level, rise = start[..., :2] - layout.center[:2], ray[..., :2]
    with np.errstate(divide="ignore", invalid="ignore"):
        nearest = -(level * rise).sum(-1) / (rise**2).sum(-1)  # to the axis, along the ray
        reach = layout.radius / np.linalg.norm(rise, axis=-1)
        ends = nearest + reach * np.array([-1, 1]).reshape(2, 1, 1)  # of what counts of it
        heights = start[..., 2] - layout.center[2] + ends * ray[..., 2]
    if not np.isfinite(heights).all():  # a ray along the axis
        return 0.0, float(layout.shape[0])
    planes = heights / layout.voxel_size + layout.shape[0] / 2
    return float(np.clip(planes.min(), 0, layout.shape[0])), float(np.clip(planes.max(), 0, layout.shape[0]))
