"""Touching grains of one material separated: distance transform, watershed, merging of basins.

Grains are separated in their *cores*, the voxels well above the half-way level between air and grain
(`CORE_LEVEL`): blur bridges the gap at a contact at the half-way level, hardly in the cores.  A watershed of
the cores' distance transform cuts angular grains into several basins.  These are merged in two steps over
the graph of touching basins, with s the saddle between two (the half-width of the neck), m the lower of
their two peaks (the half-width of the smaller) and A the area of the neck:

1. **Depth** (H-minima): a basin is merged if m − s < ``depth`` voxels, as voxelisation causes, or
   s > 0.9 m, as an uneven surface causes.
2. **Neck**, independent of scale, the widest first: two basins are one grain if

       κ = s² A / (π m⁴) ≥ ``oneness``.

   A s² is proportional to the second moment of area of the neck, so κ compares the bending stiffness of the
   neck with that of the smaller basin's thickest round section: two halves of one grain give about 1 or
   more, however flat or long it is, two touching grains much less.

A neck that is fainter than its basins at equal depth is a valley between two grains whose faces blur joins (`valleys`):
κ is multiplied by how flat it is, 1 to 0, and no basin is merged across one in the first step.

Then the labels grow from the cores into all voxels above the threshold, bright ones first.

Soille (2003) for the watershed of distances; `docs/decisions/0002-segmentation.md` for the criterion.
"""

from __future__ import annotations

import edt
import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from skimage.segmentation import relabel_sequential, watershed

from grainmotion.segmentation.region_merging import BasinGraph
from grainmotion.segmentation.settings import SegmentSettings
from grainmotion.segmentation.valleys import deficits

Ints = NDArray[np.int32]
Bools = NDArray[np.bool_]

CORE_LEVEL = 0.75
"""Level of the cores: 0 is the mean outside the grains, 1 the grain's own attenuation nearby."""
CORE_WINDOW = 9
"""Edge of the cube over which a grain's own attenuation is averaged, voxels."""
MIN_GRAIN_VOXELS = 30
"""Smallest grain in any case, voxels."""
TIP = 0.05
"""Volume of a tip over that of a typical grain, at most."""
TIP_CONTACT = 0.08
"""Share of a tip's surface in its neck, at least."""
BROAD_CONTACT = 0.18
"""The same for a larger piece of a grain: 0.2 to 0.4, up to 0.13 in grains that touch."""
NECK_LEVEL = (1.06, 1.45)
"""Attenuation of the middle of the neck over the mean of the piece: 1.07 to 1.4, up to 1.03 in small grains that touch;
more where grains cut by the border of the volume meet, which is too bright there.
"""
NECK_FACES = 4
"""Faces in the middle of the neck."""
MIN_GRAIN_SHARE = 0.02
"""Smallest grain unless given, over the median grain's volume."""


def separated(array: NDArray[np.float32], solid: Bools, threshold: float, settings: SegmentSettings) -> Ints:
    """Labels of the grains of one material, in all its voxels.

    Parameters
    ----------
    array : (nz, ny, nx) array
        Attenuation above what surrounds the grains, 1/mm.
    solid : (nz, ny, nx) bool array
        Voxels of the grains.
    threshold : float
        Attenuation from which a voxel is grain, 1/mm.
    settings : SegmentSettings
        ``depth``, ``oneness`` and ``min_volume``.

    Returns
    -------
    (nz, ny, nx) int32 array
        0 for no grain, 1 … n for the grains; pieces of fewer than `MIN_GRAIN_VOXELS` are left out.
    """
    labels = np.zeros(array.shape, np.int32)
    box = bounding_box(solid)
    if box is None:
        return labels
    array, solid = array[box], solid[box]
    smallest = min(settings.min_volume or MIN_GRAIN_VOXELS, MIN_GRAIN_VOXELS)
    level = _own_level(array, solid)
    distance = edt.edt(_cores(array, solid, level, threshold), parallel=1)
    basins = distance_basins(distance)
    graph = BasinGraph.of(distance, basins, *deficits(level, distance))
    cores = graph.merged(settings.depth, settings.oneness)[basins]
    labels[box] = without_fragments(array, watershed(-array, without_small(cores, smallest), mask=solid))
    return labels


def without_fragments(array: NDArray[np.float32], labels: Ints) -> Ints:
    """Labels in which pieces that a neck of full attenuation joins to a neighbour belong to that neighbour.

    Blur leaves a valley between two grains that touch, so their neck is fainter than they are, and it takes a small
    part of their surface.  A piece of a grain has a broad neck, a thin tip at least one as dense as itself.

    Parameters
    ----------
    array : (nz, ny, nx) array
        Attenuation, 1/mm.
    labels : (nz, ny, nx) int32 array
        0 for no grain.

    Returns
    -------
    (nz, ny, nx) int32 array
        The same labels, fewer of them.
    """
    while True:
        new = _hosts(array, labels)
        if (new == np.arange(len(new))).all():
            return labels
        labels = new[labels]


def _hosts(array: NDArray[np.float32], labels: Ints) -> Ints:
    """Of each label itself, or the neighbour of which it is a fragment."""
    sizes = np.bincount(labels.ravel())
    sizes[0] = 0
    new = np.arange(len(sizes), dtype=np.int32)
    present = np.sort(sizes[sizes > 0])
    if len(present) < 2:
        return new
    weights = np.cumsum(np.sqrt(present))
    tip = TIP * present[np.searchsorted(weights, weights[-1] / 2)]
    means = np.bincount(labels.ravel(), array.ravel()) / np.maximum(sizes, 1)
    low, high = NECK_LEVEL
    for label, (host, share, dense) in _necks(array, labels).items():
        least = TIP_CONTACT if sizes[label] < tip else BROAD_CONTACT
        smaller = (sizes[label], label) < (sizes[host], host)  # a total order: no chain leads back
        if smaller and share > least and low < dense / means[label] < high:
            new[label] = host
    for label in np.argsort(-sizes, kind="stable"):  # hosts that are fragments themselves
        new[label] = new[new[label]]
    return new


def _necks(array: NDArray[np.float32], labels: Ints) -> dict[int, tuple[int, float, float]]:
    """Of each label the neighbour of the broadest neck, its share of the label's surface and its attenuation."""
    first, second, value = list[NDArray](), list[NDArray](), list[NDArray]()
    surface = np.zeros(int(labels.max()) + 1)
    for axis in range(3):
        own, level = np.moveaxis(labels, axis, 0), np.moveaxis(array, axis, 0)
        a, b = own[:-1], own[1:]
        apart = a != b
        surface += np.bincount(a[apart], minlength=len(surface)) + np.bincount(b[apart], minlength=len(surface))
        touch = apart & (a > 0) & (b > 0)
        first.append(a[touch])
        second.append(b[touch])
        value.append(np.minimum(level[:-1][touch], level[1:][touch]))
    one, other, dense = np.concatenate(first), np.concatenate(second), np.concatenate(value)
    key = np.concatenate([one, other]).astype(np.int64) * len(surface) + np.concatenate([other, one])
    dense = np.concatenate([dense, dense])
    order = np.lexsort((-dense, key))
    pairs, start, count = np.unique(key[order], return_index=True, return_counts=True)
    found = dict[int, tuple[int, float, float]]()
    for k in np.argsort(count, kind="stable"):  # the broadest last
        label, host = divmod(int(pairs[k]), len(surface))
        middle = dense[order][start[k] : start[k] + NECK_FACES]
        if len(middle) == NECK_FACES:
            found[label] = (host, float(count[k] / surface[label]), float(middle.mean()))
    return found


def large_enough(labels: Ints, settings: SegmentSettings) -> tuple[Ints, NDArray[np.intp]]:
    """Labels without small ones, numbered 1 … n, and the old number of each (0 first)."""
    sizes = np.bincount(labels.ravel())
    present = sizes[1:][sizes[1:] > 0]
    smallest = settings.min_volume or (
        max(MIN_GRAIN_VOXELS, int(MIN_GRAIN_SHARE * np.median(present))) if len(present) else MIN_GRAIN_VOXELS
    )
    kept = np.flatnonzero(sizes >= smallest)
    return without_small(labels, smallest), np.concatenate([[0], kept[kept > 0]])


def bounding_box(solid: Bools) -> tuple[slice, slice, slice] | None:
    """The smallest box that holds all solid voxels, and one voxel more on each side; None without any."""
    box = []
    for axis in range(3):
        layers = np.flatnonzero(solid.any(axis=tuple({0, 1, 2} - {axis})))
        if len(layers) == 0:
            return None
        box.append(slice(max(int(layers[0]) - 1, 0), int(layers[-1]) + 2))
    return box[0], box[1], box[2]


def _own_level(array: NDArray[np.float32], solid: Bools) -> NDArray[np.float32]:
    """Attenuation of each voxel: 0 is the mean outside the grains, 1 the grain's own nearby.

    A grain fainter than the others has a lower one of its own; inclusions brighter than the others do not raise it.
    """
    bright = float(np.median(array[solid]))
    outside = array[~solid]
    dark = float(outside.mean()) if outside.size else 0.0
    inner = ndimage.binary_erosion(solid)
    weight = ndimage.uniform_filter(inner.astype(np.float32), CORE_WINDOW)
    own = ndimage.uniform_filter(np.where(inner, np.minimum(array, bright), 0).astype(np.float32), CORE_WINDOW)
    averaged = weight > 1 / CORE_WINDOW**3
    own = np.where(averaged, own / np.where(averaged, weight, 1), bright)
    return np.asarray((array - dark) / np.where(own > dark, own - dark, 1), np.float32)


def _cores(array: NDArray[np.float32], solid: Bools, level: NDArray[np.float32], threshold: float) -> Bools:
    """Voxels above `CORE_LEVEL` of their grain's own attenuation and above the threshold."""
    cores = ndimage.binary_fill_holes(solid & (array > threshold) & (level > CORE_LEVEL))
    pieces, n = ndimage.label(solid)
    coreless = np.ones(n + 1, dtype=bool)
    coreless[pieces[cores]] = False
    coreless[0] = False
    return cores | coreless[pieces]  # a piece too thin or too faint for a core is its own core


def distance_basins(distance: NDArray[np.float32]) -> Ints:
    """Watershed basins of the distance, one for each of its local maxima."""
    inside = distance > 0
    peaks = (distance == ndimage.maximum_filter(distance, size=3)) & inside
    seeds, _ = ndimage.label(peaks, np.ones((3, 3, 3)))
    return watershed(-distance, seeds, mask=inside).astype(np.int32)


def without_small(labels: Ints, smallest: int) -> Ints:
    """Labels of at least ``smallest`` voxels, numbered 1 … n.

    `skimage.morphology.remove_small_objects` takes three times as long, and warns of a volume with one grain.
    """
    sizes = np.bincount(labels.ravel())
    sizes[0] = 0
    numbers = relabel_sequential(np.where(sizes >= smallest, np.arange(len(sizes)), 0))[0]
    return np.asarray(numbers, np.int32)[labels]
