"""A volume under way in slabs along z: the one mathematics of a reconstruction on processors, whoever holds them.

A projection is linear in the volume, so the line integrals of the whole are the sum of those of its slabs, and a
slab of the adjoint needs its own rows of the corrections only:

    forward of each slab ── compare its rows (with the slabs that shade them, too) ── advance it

How the volume is cut follows from the grid alone.  One process and the workers of a cluster call these functions
with the same arguments, so they find the same bits (decision 0013).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from grainmotion._typing import Float, Image
from grainmotion.kernels import sart
from grainmotion.kernels.layout import PADDING
from grainmotion.model.geometry import Geometry
from grainmotion.model.volume import Volume
from grainmotion.reconstruction.settings import ReconstructSettings
from grainmotion.reconstruction.system import Frame, Imaging, Views

THICKNESS = 160
"""Planes of a slab, within a factor √2 (but see `LARGE`): thinner ones see many rows of pixels in common."""
LARGE = 1 << 22
"""Voxels from which a grid is cut in two at least: smaller ones are done sooner than they are shared out."""
MARGIN = 0.55
"""Voxels beyond its faces that a slab shades: it is interpolated up to the next voxel's middle."""
RING = 48
"""Points of the ring of which a slab's upright cylinder is taken to be made."""

Rows = tuple[int, int]
"""First row of pixels and the row after the last."""


@dataclass(frozen=True, eq=False)
class Layout:
    """A grid without its values: how it is cut, and what sees it.

    Attributes
    ----------
    shape, voxel_size, center
        As of a `Volume`.
    frame : Frame
        Where rays count.
    geometry : Geometry
    settings : ReconstructSettings
    slabs : tuple of (int, int)
        First plane of each slab and the plane after its last.
    """

    shape: tuple[int, int, int]
    voxel_size: float
    center: tuple[float, float, float]
    frame: Frame
    geometry: Geometry
    settings: ReconstructSettings
    slabs: tuple[tuple[int, int], ...]

    @classmethod
    def of(cls, grid: Volume, geometry: Geometry, settings: ReconstructSettings) -> Layout:
        """That of a whole grid."""
        frame = Frame.of(grid, settings)
        return cls(grid.shape, grid.voxel_size, grid.center, frame, geometry, settings, cut(grid.shape))

    def center_of(self, number: int) -> tuple[float, float, float]:
        """Middle of a slab, mm."""
        x, y, z = self.center
        first, end = self.slabs[number]
        return x, y, z + self.voxel_size * ((first + end) - self.shape[0]) / 2

    @cached_property
    def shaded(self) -> tuple[Rows, ...]:
        """Of each slab the rows of pixels that it may shade in any view."""
        return tuple(self._shaded_by(k) for k in range(len(self.slabs)))

    @cached_property
    def watched(self) -> tuple[Rows, ...]:
        """Of each slab the rows to be compared with it: those that it shades, and all rows are with some slab."""
        order = sorted(range(len(self.slabs)), key=lambda k: self.shaded[k])
        edges = [0, *(self.shaded[k][0] for k in order[1:]), self.geometry.shape[0]]
        found = {}
        for k, edge, following in zip(order, edges[:-1], edges[1:], strict=True):
            found[k] = min(edge, self.shaded[k][0]), max(following, self.shaded[k][1])
        return tuple(found[k] for k in range(len(self.slabs)))

    def beside(self, number: int) -> list[int]:
        """The slabs, itself among them, that shade rows which are compared with a slab."""
        first, end = self.watched[number]
        return [k for k, (a, b) in enumerate(self.shaded) if a < end and b > first]

    @property
    def radius(self) -> float:
        """Radius of the upright cylinder beyond which nothing counts, mm."""
        _, ny, nx = self.shape
        return float((min(nx, ny) if self.settings.circular else np.hypot(nx, ny)) / 2 + 1.5) * self.voxel_size

    def _shaded_by(self, number: int) -> Rows:
        turn = 2 * np.pi * np.arange(RING) / RING
        ring = self.radius / self.voxel_size / np.cos(np.pi / RING) * np.stack([np.cos(turn), np.sin(turn)], axis=-1)
        height = (self.slabs[number][1] - self.slabs[number][0]) / 2 + MARGIN
        rim = np.concatenate([np.c_[ring, np.full(RING, side * height)] for side in (-1, 1)])
        spots = self.geometry.project_points(rim * self.voxel_size + self.center_of(number))[..., 0]
        rows = self.geometry.shape[0]
        if not np.isfinite(spots).all():  # a source beside or in the volume
            return 0, rows
        first = int(np.clip(np.floor(spots.min()), 0, rows - 1))
        return first, int(np.clip(np.ceil(spots.max()) + 1, first + 1, rows))


def cut(shape: tuple[int, int, int]) -> tuple[tuple[int, int], ...]:
    """First plane of each slab of a grid, and the plane after its last; a power of two of them, to be shared evenly."""
    fewest = 2 if np.prod(shape, dtype=float) >= LARGE else 1
    count = min(shape[0], max(fewest, 2 ** round(np.log2(max(shape[0] / THICKNESS, 1)))))
    ends = np.round(np.linspace(0, shape[0], count + 1)).astype(int)
    return tuple((int(a), int(b)) for a, b in pairwise(ends))


@dataclass(frozen=True, eq=False)
class Slab:
    """Some planes of the volume, laid as ``imaging.operator`` lays them.

    Attributes
    ----------
    imaging : Imaging
        How its rows of pixels see it.
    first : int
        The first of those rows.
    image : array
        It under way.
    before : array, optional
        It as it was last constrained, where momentum drives it.
    """

    imaging: Imaging
    first: int
    image: Image
    before: Image | None = None

    @property
    def planes(self) -> Image:
        """It as it was last constrained, ``[z, y, x]``, without a copy."""
        latest, inner = self.image if self.before is None else self.before, slice(PADDING, -PADDING)
        return self.imaging.operator.by_height(latest)[inner, inner, inner].transpose(2, 0, 1)


@dataclass(frozen=True, eq=False)
class Strip:
    """Line integrals ``(views, rows, columns)`` of a slab, from row ``first`` on."""

    first: int
    images: Image


@dataclass(frozen=True, eq=False)
class RadiographRows:
    """Radiographs ``(views, rows, columns)`` from row ``first`` on, and which of their pixels count (None: all)."""

    first: int
    images: Image
    valid: NDArray[np.bool_] | None


@dataclass(frozen=True, eq=False)
class Corrections:
    """What is to be projected back, rows ``first …``; of each row Σ(b − A x)² and Σb² before it, ``(rows, 2)``."""

    first: int
    images: Image
    squares: Float


def new_slab(layout: Layout, number: int, array: Image) -> Slab:
    """A slab of the values ``[z, y, x]`` of its planes."""
    imaging = imaging_of(layout, number, array)
    return Slab(imaging, layout.shaded[number][0], imaging.start())


def slab_from(layout: Layout, number: int, array: Image, planes: Image) -> Slab:
    """A slab of the values ``[z, y, x]`` of its planes, as far as they are allowed; ``array`` is the grid's own."""
    imaging = imaging_of(layout, number, array)
    image = imaging.operator.padded(planes)
    imaging.constrain(image)
    return Slab(imaging, layout.shaded[number][0], image)


def imaging_of(layout: Layout, number: int, array: Image) -> Imaging:
    """How the rows that a slab shades see it, whose values are ``array``."""
    first, end = layout.shaded[number]
    window = layout.geometry.window((first, 0), (end - first, layout.geometry.shape[1]))
    return Imaging(window, Volume(array, layout.voxel_size, layout.center_of(number)), layout.settings)


def forward(slab: Slab, views: Views) -> Strip:
    """Its line integrals in some views."""
    return Strip(slab.first, slab.imaging.operator.forward(slab.image, views))


def compare(layout: Layout, views: Views, parts: Sequence[Strip], seen: RadiographRows, step: float) -> Corrections:
    """Corrections, times ``step``, of what was seen of some views: ``parts`` are all slabs' that shade it, in order."""
    count, rows = seen.images.shape[:2]
    sums = np.zeros(seen.images.shape)  # double: else slabs would leave more rounding than one walk
    for part in parts:
        low, high = max(part.first, seen.first), min(part.first + part.images.shape[1], seen.first + rows)
        sums[:, low - seen.first : high - seen.first] += part.images[:, low - part.first : high - part.first]
    images, frame, geometry = sums.astype(np.float32), layout.frame, layout.geometry
    valid = np.ones(images.shape, np.bool_) if seen.valid is None else seen.valid
    squares = np.empty((count * rows, 2))
    sart.compare(
        images, seen.images, valid, frame.origin, frame.voxel_size, frame.size, frame.radius, geometry.vectors[views],
        geometry.beam == "cone", seen.first, geometry.shape[0], squares,
    )  # fmt: skip
    images *= np.float32(step)
    total = np.zeros((rows, 2))
    for of_view in squares.reshape(count, rows, 2):  # in this order whatever the rows
        total += of_view
    return Corrections(seen.first, images, total)


def advance(slab: Slab, corrections: Corrections, views: Views, momentum: float) -> None:
    """Project corrections of some views back, constrain the slab and, with momentum, go on; all in place."""
    first, end = slab.first - corrections.first, slab.first - corrections.first + slab.imaging.geometry.shape[0]
    slab.imaging.operator.add_adjoint(corrections.images[:, first:end], slab.image, views)
    if slab.before is None:
        slab.imaging.constrain(slab.image)
    else:
        slab.imaging.constrain_and_extrapolate(slab.image, slab.before, momentum)


def total(squares: Sequence[Float], rows: Sequence[Rows]) -> Float:
    """Σ(b − A x)² and Σb² of all rows, from what is known of some rows each (where twice, the same)."""
    whole = np.zeros((max(end for _, end in rows), 2))
    for part, (first, end) in zip(squares, rows, strict=True):
        whole[first:end] = part
    found: Float = whole.sum(axis=0)
    return found
