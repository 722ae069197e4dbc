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

import threading

import numpy as np
from numpy.typing import NDArray

from grainmotion.model.large_arrays import large_zeros
from grainmotion.segmentation.blocks import Block, Work
from grainmotion.segmentation.distance_basins import distances, label_basins
from grainmotion.segmentation.flooding import grow_labels
from grainmotion.segmentation.fragments import without_fragments
from grainmotion.segmentation.heights import Heights
from grainmotion.segmentation.label_measures import highest_label, kept_numbers, label_sizes, label_sums, renumber
from grainmotion.segmentation.label_pairs import LabelPairs
from grainmotion.segmentation.own_level import OwnLevel
from grainmotion.segmentation.region_merging import BasinGraph, Deficits
from grainmotion.segmentation.settings import SegmentSettings
from grainmotion.segmentation.valleys import NOISE_BINS, Valleys

Ints = NDArray[np.int32]
Bools = NDArray[np.bool_]

MIN_GRAIN_VOXELS = 30
"""Smallest grain in any case, voxels."""
MIN_GRAIN_SHARE = 0.02
"""Smallest grain unless given, over the median grain's volume."""
MARK = float(1 << 24)
"""Deficits are added up in whole numbers of its inverse."""


def separated(
    heights: Heights,
    solid: Bools,
    threshold: float,
    settings: SegmentSettings,
    work: Work | None = None,
    labels: Ints | None = None,
) -> Ints:
    """Labels of the grains of one material, in all its voxels.

    Parameters
    ----------
    heights : Heights
        Attenuation above what surrounds the grains, 1/mm.
    solid : (nz, ny, nx) bool array
        Voxels of the grains.
    threshold : float
        Attenuation from which a voxel is grain, 1/mm.
    settings : SegmentSettings
        ``depth``, ``oneness`` and ``min_volume``.
    work : Work, optional
        Threads.
    labels : (nz, ny, nx) int32 array, optional
        Where to write them, 0 but for labels that are `set_aside`.

    Returns
    -------
    (nz, ny, nx) int32 array
        0 for no grain; pieces of fewer than `MIN_GRAIN_VOXELS` are left out.
    """
    work, labels = work or Work(), large_zeros(heights.shape, np.int32) if labels is None else labels
    box = bounding_box(solid)
    if box is None:
        return labels
    smallest = min(settings.min_volume or MIN_GRAIN_VOXELS, MIN_GRAIN_VOXELS)
    count = _label_cores(labels, OwnLevel.of(heights, solid, box, work), threshold, smallest, settings, work)
    array = heights.whole(work)
    grow_labels(labels, array, count, work)
    pairs = LabelPairs.of(labels, array, count, work)
    sizes, sums = label_sizes(labels, count, work), label_sums(labels, array, count, work)
    renumber(labels, without_fragments(pairs, sizes, sums), work)
    return labels


def _label_cores(
    labels: Ints, level: OwnLevel, threshold: float, smallest: int, settings: SegmentSettings, work: Work
) -> int:
    """Label the grains' cores 1 … n, other voxels of grains -1; returns n."""
    box = bounding_box(level.solid)
    assert box is not None
    distance = distances(level.cores(threshold, box, work), work)
    peaks = label_basins(labels, distance, work)
    graph, sizes = _graph(level, distance, labels, peaks, work)
    new = graph.merged(settings.depth, settings.oneness)
    kept = kept_numbers(np.bincount(new, sizes) >= smallest)
    renumber(labels, kept[new], work, level.solid)
    return int(kept.max())


def _graph(
    level: OwnLevel, distance: NDArray[np.float32], basins: Ints, peaks: NDArray[np.float64], work: Work
) -> tuple[BasinGraph, NDArray[np.int64]]:
    """The graph of the cores' basins with their deficits, and the voxels of each basin."""
    count, noise, lock = len(peaks) - 1, np.zeros(NOISE_BINS, np.int64), threading.Lock()
    valleys = Valleys.of(level.at, distance, work, level.heights.blurred)

    def marks(block: Block) -> NDArray[np.int32]:
        deficits = valleys.deficits(block)
        found = valleys.noise_counts(block, deficits)
        with lock:
            noise[:] += found
        return np.rint(deficits * np.float32(MARK)).astype(np.int32)

    pairs = LabelPairs.of(basins, distance, count, work, marks)
    sizes = label_sizes(basins, count, work)
    known = Deficits(pairs.label_marks / MARK, sizes.astype(float), pairs.marks / (2 * MARK), valleys.noise_of(noise))
    return BasinGraph.of_pairs(peaks, pairs, known), sizes


def large_enough(labels: Ints, settings: SegmentSettings, work: Work | None = None) -> NDArray[np.intp]:
    """Take small labels out and number the others 1 … n, in place; returns the old number of each (0 first)."""
    work = work or Work()
    sizes = label_sizes(labels, highest_label(labels, work), work)
    present = sizes[1:][sizes[1:] > 0]
    smallest = settings.min_volume or (
        max(MIN_GRAIN_VOXELS, int(MIN_GRAIN_SHARE * np.median(present))) if len(present) else MIN_GRAIN_VOXELS
    )
    numbers = kept_numbers(sizes >= smallest)
    renumber(labels, numbers, work)
    return np.concatenate([[0], np.flatnonzero(numbers)])


def bounding_box(solid: Bools) -> tuple[slice, slice, slice] | None:
    """The smallest box that holds all solid voxels, and one voxel more on each side; None without any."""
    box = []
    for axis in range(3):
        layers = np.flatnonzero(solid.any(axis=tuple({0, 1, 2} - {axis})))
        if len(layers) == 0:
            return None
        box.append(slice(max(int(layers[0]) - 1, 0), min(int(layers[-1]) + 2, solid.shape[axis])))
    return box[0], box[1], box[2]
