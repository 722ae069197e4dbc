"""Labels of the grains that the border of the field of view cuts."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from grainmotion._typing import Float
from grainmotion.model.field_of_view import FieldOfView
from grainmotion.model.volume import Volume

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
    edge = np.zeros(labels.shape, dtype=bool)
    edge[[0, -1]] = edge[:, [0, -1]] = edge[:, :, [0, -1]] = True
    edge[:, _distances(ny, nx) > min(ny, nx) / 2 - 1.5] = True
    return tuple(int(i) for i in np.unique(labels[edge]) if i)


def cut_labels(labels: NDArray[np.integer], volume: Volume) -> tuple[int, ...]:
    """Labels that reach beyond what nearly all views saw, or the edge of the volume.

    Where it is not known what they saw: `border_labels`.
    """
    field = volume.field
    if field is None:
        return border_labels(labels)
    nz, ny, nx = labels.shape
    found = set[int]()
    if nz > 1:
        found.update(np.unique(labels[[0, -1]]).tolist())
    found.update(np.unique(labels[:, _distances(ny, nx) > min(ny, nx) / 2 - 0.5]).tolist())
    out = beyond_field(volume)
    if out is not None:
        found.update(np.unique(labels[out]).tolist())
        found |= _ending_at(out, labels, volume)
    return tuple(sorted(int(label) for label in found if label))


def _ending_at(out: NDArray[np.bool_], labels: NDArray[np.integer], volume: Volume) -> set[int]:
    """Labels that end at the border of what was seen with their full attenuation, not with a blurred surface."""
    counts = np.bincount(labels.ravel())
    least = FULL_SHARE * np.bincount(labels.ravel(), weights=volume.array.ravel()) / np.maximum(counts, 1)
    ends = ndimage.binary_dilation(out) & (labels > 0)
    full = labels[ends][volume.array[ends] > least[labels[ends]]]
    return set(np.flatnonzero(np.bincount(full, minlength=1) >= MIN_CUT_VOXELS).tolist())


def beyond_field(volume: Volume) -> NDArray[np.bool_] | None:
    """Voxels ``(nz, ny, nx)`` that not nearly all views saw; None if all were seen, or if it is not known."""
    field = volume.field
    if field is None or field.holds_all:
        return None
    low, high, aside = _borders(field, volume)
    heights = (volume.origin[2] + volume.voxel_size * np.arange(volume.shape[0]))[:, None, None]
    return np.asarray(aside | (heights > high) | (heights < low))


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
