"""Labels of the grains that the border of the field of view cuts."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from grainmotion._typing import Float
from grainmotion.model.field_of_view import FieldOfView
from grainmotion.model.volume import Volume
from grainmotion.segmentation.blocks import Block, Work, blocks_of
from grainmotion.segmentation.label_measures import highest_label, label_sizes, label_sums

WHOLE_SHARE = 0.95
"""Share of the reference's views that must have seen all of a grain: what a few views miss is reconstructed as well."""
FULL_SHARE, MIN_CUT_VOXELS = 0.8, 9
"""Attenuation of a voxel at the border of the field, over the mean of its grain, from which the grain goes on there,
and the number of such voxels from which a grain is cut: beyond the border the volume may be empty."""
FIELD_LATTICE = 2
"""Voxels, along x and y, between the places at which the field's borders are evaluated."""


def border_labels(labels: NDArray[np.integer]) -> tuple[int, ...]:
    """Labels that touch a face of the array, or the side of its inscribed upright cylinder."""
    _, ny, nx = labels.shape
    aside = _distances(ny, nx) > min(ny, nx) / 2 - 1.5
    aside[[0, -1]] = aside[:, [0, -1]] = True
    found = set(np.unique(labels[[0, -1]]).tolist()) | _present(labels, aside)
    return tuple(sorted(int(label) for label in found if label))


def cut_labels(labels: NDArray[np.integer], volume: Volume, work: Work | None = None) -> tuple[int, ...]:
    """Labels that reach beyond what nearly all views saw, or the edge of the volume.

    Where it is not known what they saw: `border_labels`.
    """
    field, work, labels = volume.field, work or Work(), labels.astype(np.int32, copy=False)
    if field is None:
        return border_labels(labels)
    nz, ny, nx = labels.shape
    found = set[int]()
    if nz > 1:
        found.update(np.unique(labels[[0, -1]]).tolist())
    found.update(_present(labels, _distances(ny, nx) > min(ny, nx) / 2 - 0.5))
    out = beyond_field(volume)
    if out is not None:
        blocks = blocks_of(labels.shape)
        found.update(*work.each(blocks, lambda block: set(np.unique(labels[block.box][out.of(block)]).tolist())))
        found |= _ending_at(out, labels, volume, work)
    return tuple(sorted(int(label) for label in found if label))


def _present(labels: NDArray[np.integer], columns: NDArray[np.bool_]) -> set[int]:
    """Labels in some columns of voxels."""
    seen = np.zeros(int(labels.max(initial=0)) + 1, bool)
    for plane in labels:
        seen[plane[columns]] = True
    return set(np.flatnonzero(seen).tolist())


def _ending_at(out: BeyondField, labels: NDArray[np.integer], volume: Volume, work: Work) -> set[int]:
    """Labels that end at the border of what was seen with their full attenuation, not with a blurred surface."""
    count = highest_label(labels, work)
    sizes, sums = label_sizes(labels, count, work), label_sums(labels, volume.array, count, work)
    least = FULL_SHARE * sums / np.maximum(sizes, 1)

    def add(block: Block, full: NDArray[np.int64]) -> NDArray[np.int64]:
        own = labels[block.box]
        wide = block.grown(1, labels.shape)
        beyond = out.of(wide)
        if own.any() and beyond.any():
            within = tuple(slice(a - b, a - b + n) for a, b, n in zip(block.start, wide.start, own.shape, strict=True))
            at_end = ndimage.binary_dilation(beyond)[within] & (own > 0)
            ends, values = own[at_end], volume.array[block.box][at_end]
            full += np.bincount(ends[values > least[ends]], minlength=len(full))
        return full

    parts = work.gathered(blocks_of(labels.shape), lambda: np.zeros(count + 1, np.int64), add)
    return set(np.flatnonzero(np.asarray(sum(parts)) >= MIN_CUT_VOXELS).tolist())


@dataclass(frozen=True, eq=False)
class BeyondField:
    """Voxels that not nearly all views saw.

    Attributes
    ----------
    heights : (nz,) array
        Of the layers, mm.
    low, high : (ny, nx) arrays
        Heights between which nearly all views see a column of voxels, mm.
    aside : (ny, nx) bool array
        Columns beside the field.
    """

    heights: Float
    low: Float
    high: Float
    aside: NDArray[np.bool_]

    def of(self, block: Block) -> NDArray[np.bool_]:
        """Whether the voxels of a block are beyond the field."""
        z, y, x = block.box
        heights = self.heights[z, None, None]
        return np.asarray(self.aside[y, x] | (heights > self.high[y, x]) | (heights < self.low[y, x]))


def beyond_field(volume: Volume) -> BeyondField | None:
    """Voxels that not nearly all views saw; None if all were seen, or if it is not known."""
    field = volume.field
    if field is None or field.holds_all:
        return None
    heights = volume.origin[2] + volume.voxel_size * np.arange(volume.shape[0])
    return BeyondField(heights, *_borders(field, volume))


def _distances(ny: int, nx: int) -> Float:
    """Voxels ``(ny, nx)`` from the axis of a volume."""
    y, x = np.arange(ny) - (ny - 1) / 2, np.arange(nx) - (nx - 1) / 2
    return np.asarray(np.hypot(y[:, None], x[None, :]), dtype=float)


def _borders(field: FieldOfView, volume: Volume) -> tuple[Float, Float, NDArray[np.bool_]]:
    """Heights between which nearly all views see a column of voxels, mm, and columns beside the field ``(ny, nx)``."""
    nz, ny, nx = volume.shape
    middle = (FIELD_LATTICE - 1) / 2  # of the voxels for which a place stands
    x, y = (
        volume.origin[k] + volume.voxel_size * (np.arange(0, n, FIELD_LATTICE) + middle) for k, n in ((0, nx), (1, ny))
    )
    places = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    low, high = field.border_heights(places, WHOLE_SHARE)
    sides, seen = replace(field, above=False, below=False), np.ones(len(places))
    if field.beside:
        for z in volume.origin[2] + volume.voxel_size * np.linspace(0, nz - 1, 3):
            seen = np.minimum(seen, sides.share(np.c_[places, np.full(len(places), z)]))

    def spread(values: Float) -> Float:
        grid = values.reshape(len(y), len(x))
        return np.asarray(grid.repeat(FIELD_LATTICE, axis=0).repeat(FIELD_LATTICE, axis=1)[:ny, :nx])

    return spread(low), spread(high), spread(seen) < WHOLE_SHARE
