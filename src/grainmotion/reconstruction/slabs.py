"""Reconstruction on CPUs, in slabs along z that one process or the workers of a cluster hold.

A projection is linear in the volume, so the line integrals of the whole are the sum of those of its slabs, and a
slab of the adjoint needs only its own rows of the corrections:

    forward of each slab ── compare its rows (with all slabs that project on them) ── advance it

The slabs follow from the grid alone.  One process and the workers of a cluster call these functions with the same
arguments, so that their results are equal to the bit (decision 0013).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
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

SLAB_PLANES = 160
"""Planes of a slab, within a factor √2 (but see `MIN_SPLIT_VOXELS`): thinner ones share many rows of pixels."""
MIN_SPLIT_VOXELS = 1 << 22
"""Voxels from which a grid has two slabs at least: a smaller one takes less time than its distribution."""
SLAB_MARGIN = 0.55
"""Width beyond its faces on which a slab projects, voxels: it is interpolated up to the next voxel's centre."""
CYLINDER_POINTS = 48
"""Points on the circumference of a slab's upright cylinder whose projections bound its footprint."""

Rows = tuple[int, int]
"""First row of pixels and the row after the last."""


@dataclass(frozen=True, eq=False)
class Layout:
    """A grid without its values: its slabs, and the views of it.

    Attributes
    ----------
    shape, voxel_size, center
        As of a `Volume`.
    frame : Frame
        Region in which rays count.
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
        """The layout of a grid."""
        frame = Frame.of(grid, settings)
        return cls(grid.shape, grid.voxel_size, grid.center, frame, geometry, settings, slab_bounds(grid.shape))

    def center_of(self, number: int) -> tuple[float, float, float]:
        """Centre of a slab, mm, x y z."""
        x, y, z = self.center
        first, end = self.slabs[number]
        return x, y, z + self.voxel_size * ((first + end) - self.shape[0]) / 2

    @cached_property
    def footprints(self) -> tuple[Rows, ...]:
        """Rows of pixels on which each slab may project in any view."""
        return tuple(self._footprint(k) for k in range(len(self.slabs)))

    @cached_property
    def compared(self) -> tuple[Rows, ...]:
        """Rows that are compared with each slab: its footprint, extended so that every row belongs to some slab."""
        order = sorted(range(len(self.slabs)), key=lambda k: self.footprints[k])
        edges = [0, *(self.footprints[k][0] for k in order[1:]), self.geometry.shape[0]]
        rows = {}
        for k, edge, following in zip(order, edges[:-1], edges[1:], strict=True):
            rows[k] = min(edge, self.footprints[k][0]), max(following, self.footprints[k][1])
        return tuple(rows[k] for k in range(len(self.slabs)))

    def overlapping(self, number: int) -> list[int]:
        """The slabs, itself included, that project on rows which are compared with a slab."""
        first, end = self.compared[number]
        return [k for k, (a, b) in enumerate(self.footprints) if a < end and b > first]

    @property
    def radius(self) -> float:
        """Radius of the upright cylinder outside which the volume does not count, mm."""
        _, ny, nx = self.shape
        return float((min(nx, ny) if self.settings.circular else np.hypot(nx, ny)) / 2 + 1.5) * self.voxel_size

    def _footprint(self, number: int) -> Rows:
        angles = 2 * np.pi * np.arange(CYLINDER_POINTS) / CYLINDER_POINTS
        circle = np.stack([np.cos(angles), np.sin(angles)], axis=-1)
        ring = self.radius / self.voxel_size / np.cos(np.pi / CYLINDER_POINTS) * circle
        height = (self.slabs[number][1] - self.slabs[number][0]) / 2 + SLAB_MARGIN
        rim = np.concatenate([np.c_[ring, np.full(CYLINDER_POINTS, side * height)] for side in (-1, 1)])
        projected = self.geometry.project_points(rim * self.voxel_size + self.center_of(number))[..., 0]
        rows = self.geometry.shape[0]
        if not np.isfinite(projected).all():  # a source beside or in the volume
            return 0, rows
        first = int(np.clip(np.floor(projected.min()), 0, rows - 1))
        return first, int(np.clip(np.ceil(projected.max()) + 1, first + 1, rows))


def slab_bounds(shape: tuple[int, int, int]) -> tuple[tuple[int, int], ...]:
    """First plane of each slab of a grid and the one after its last; a power of two of slabs, to be shared evenly."""
    fewest = 2 if np.prod(shape, dtype=float) >= MIN_SPLIT_VOXELS else 1
    count = min(shape[0], max(fewest, 2 ** round(np.log2(max(shape[0] / SLAB_PLANES, 1)))))
    ends = np.round(np.linspace(0, shape[0], count + 1)).astype(int)
    return tuple((int(a), int(b)) for a, b in pairwise(ends))


@dataclass(frozen=True, eq=False)
class Slab:
    """Some planes of the volume during its reconstruction, in the padded layout of ``imaging.operator``.

    Attributes
    ----------
    imaging : Imaging
        The projection of its planes on its rows of pixels.
    first : int
        The first of those rows.
    image : array
        Its current values.
    before : array, optional
        Its values as they were last constrained, with momentum.
    """

    imaging: Imaging
    first: int
    image: Image
    before: Image | None = None

    @property
    def constrained(self) -> Slab:
        """The slab without what momentum added since it was last constrained."""
        return self if self.before is None else replace(self, image=self.before, before=None)

    @property
    def planes(self) -> Image:
        """Its values as they were last constrained, ``[z, y, x]``, without a copy."""
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
    """Images to be projected back, from row ``first`` on; Σ(b − A x)² and Σb² of each row before it, ``(rows, 2)``."""

    first: int
    images: Image
    squares: Float


def new_slab(layout: Layout, number: int, array: Image) -> Slab:
    """A slab of the values ``[z, y, x]`` of its planes."""
    imaging = imaging_of(layout, number, array)
    operator = imaging.operator
    image = operator.padded(operator.grid.array) if array.any() else operator.empty()
    return Slab(imaging, layout.footprints[number][0], image)


def slab_from(layout: Layout, number: int, array: Image, planes: Image) -> Slab:
    """A slab of the values ``[z, y, x]`` of its planes, constrained; ``array`` is the grid's own."""
    imaging = imaging_of(layout, number, array)
    image = imaging.operator.padded(planes)
    imaging.constrain(image)
    return Slab(imaging, layout.footprints[number][0], image)


def imaging_of(layout: Layout, number: int, array: Image) -> Imaging:
    """The projection of a slab with values ``array`` on the rows of its footprint."""
    first, end = layout.footprints[number]
    window = layout.geometry.window((first, 0), (end - first, layout.geometry.shape[1]))
    return Imaging(window, Volume(array, layout.voxel_size, layout.center_of(number)), layout.settings)


def forward(slab: Slab, views: Views) -> Strip:
    """Line integrals of a slab in some views."""
    return Strip(slab.first, slab.imaging.operator.forward(slab.image, views))


def compare(layout: Layout, views: Views, parts: Sequence[Strip], measured: RadiographRows, step: float) -> Corrections:
    """Corrections, times ``step``, from measured rows and the strips of all slabs that project on them, in order."""
    count, rows = measured.images.shape[:2]
    sums = np.zeros(measured.images.shape)  # double, so that the sum over slabs adds hardly any rounding
    for part in parts:
        low, high = max(part.first, measured.first), min(part.first + part.images.shape[1], measured.first + rows)
        sums[:, low - measured.first : high - measured.first] += part.images[:, low - part.first : high - part.first]
    images, frame, geometry = sums.astype(np.float32), layout.frame, layout.geometry
    valid = np.ones(images.shape, np.bool_) if measured.valid is None else measured.valid
    squares = np.empty((count * rows, 2))
    sart.compare(
        images, measured.images, valid, frame.origin, frame.voxel_size, frame.size, frame.radius,
        geometry.vectors[views], geometry.beam == "cone", measured.first, geometry.shape[0], squares,
    )  # fmt: skip
    images *= np.float32(step)
    total = np.zeros((rows, 2))
    for of_view in squares.reshape(count, rows, 2):  # view by view, so that the result does not depend on the rows
        total += of_view
    return Corrections(measured.first, images, total)


def advance(slab: Slab, corrections: Corrections, views: Views, momentum: float) -> None:
    """Project corrections of some views back, constrain the slab and apply momentum if it has any; all in place."""
    first, end = slab.first - corrections.first, slab.first - corrections.first + slab.imaging.geometry.shape[0]
    slab.imaging.operator.add_adjoint(corrections.images[:, first:end], slab.image, views)
    if slab.before is None:
        slab.imaging.constrain(slab.image)
    else:
        slab.imaging.constrain_and_extrapolate(slab.image, slab.before, momentum)


def total(squares: Sequence[Float], rows: Sequence[Rows]) -> Float:
    """Σ(b − A x)² and Σb² of all rows, from those of parts that may overlap."""
    whole = np.zeros((max(end for _, end in rows), 2))
    for part, (first, end) in zip(squares, rows, strict=True):
        whole[first:end] = part
    sums: Float = whole.sum(axis=0)
    return sums
