"""Depth of voxels in the cores of grains, and its basins, one a local maximum."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from grainmotion.kernels.distance_transform import distances_along_z, squares_in_plane
from grainmotion.kernels.nearest_codes import nearest_along_z, nearest_in_plane
from grainmotion.kernels.steepest_ascent import climb_to_peaks, find_peaks, label_places
from grainmotion.model.large_arrays import large_empty, large_zeros
from grainmotion.segmentation.blocks import Work, slabs_of
from grainmotion.segmentation.label_measures import label_boxes

Ints = NDArray[np.int32]
Floats = NDArray[np.float32]


def distances(mask: NDArray[np.bool_], work: Work) -> Floats:
    """Distance of each voxel of a mask from the nearest one outside of it, voxels; what lies beyond is not outside."""
    inside, out = mask.view(np.uint8), large_empty(mask.shape, np.float32)
    work.each(range(mask.shape[0]), lambda plane: squares_in_plane(inside, plane, out))
    work.each(range(mask.shape[1]), lambda row: distances_along_z(out, row))
    return out


def distance_basins(distance: Floats) -> Ints:
    """Watershed basins of the distance, one for each of its local maxima."""
    basins = large_zeros(distance.shape, np.int32)
    label_basins(basins, distance, Work())
    return basins


def label_basins(labels: Ints, distance: Floats, work: Work) -> NDArray[np.float64]:
    """Label the basins 1 … n of a distance, one for each of its local maxima; returns these ``(n + 1,)``.

    A voxel belongs to the basin of its highest neighbour (`kernels.steepest_ascent`), so basins do not depend on an
    order of voxels.  ``labels`` are 0, but for some that are set aside, which stay where there is no distance.
    """
    slabs = slabs_of(distance.shape)

    def ask(slab: tuple[int, int]) -> None:
        labels[slice(*slab)][distance[slice(*slab)] > 0] = -1

    work.each(slabs, ask)
    places = np.concatenate(work.each(slabs, lambda slab: find_peaks(distance, *slab)))
    peaks = np.zeros(label_places(labels, places) + 1)
    peaks[labels.reshape(-1)[places]] = distance.reshape(-1)[places]
    work.each(slabs, lambda slab: climb_to_peaks(distance, labels, *slab))
    return peaks


def largest_balls(labels: Ints, count: int, work: Work) -> NDArray[np.float64]:
    """Radius ``(count + 1,)`` of the largest ball in each label: distance from the nearest voxel of another number."""
    low, high = label_boxes(labels, count, work)

    def radius(label: int) -> float:
        if label == 0 or not high[label, 0]:
            return 0.0
        box = tuple(slice(max(a - 1, 0), b + 1) for a, b in zip(low[label], high[label], strict=True))
        inside = (labels[box] == label).view(np.uint8)
        distance = np.empty(inside.shape, np.float32)
        for plane in range(inside.shape[0]):
            squares_in_plane(inside, plane, distance)
        for row in range(inside.shape[1]):
            distances_along_z(distance, row)
        return float(distance.max())

    return np.array(work.each(range(count + 1), radius))


def nearest_codes(codes: NDArray[np.int8], wanted: NDArray[np.bool_], work: Work) -> NDArray[np.int8]:
    """Of every voxel the code of the nearest one that is wanted, 0 if there is none."""
    squares, nearest = large_empty(codes.shape, np.float32), large_zeros(codes.shape, np.int8)
    mask = wanted.view(np.uint8)
    work.each(range(codes.shape[0]), lambda plane: nearest_in_plane(mask, codes, plane, squares, nearest))
    work.each(range(codes.shape[1]), lambda row: nearest_along_z(squares, nearest, row))
    return nearest
