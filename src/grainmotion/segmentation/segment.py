"""Segmentation: Volume → labels.  Threshold, distance transform, watershed, and which basins are one grain.

Grains are told apart in their *cores*, the voxels well above the half-way level between air and grain
(`CORE`): blur bridges the gap at a contact at the half-way level, hardly in the cores.  A watershed of
the cores' distance transform cuts angular grains into several basins.  They are put together again in
two steps over the graph of touching basins, with s the saddle between two (the half-width of the neck),
m the lower of their two peaks (the half-width of the smaller) and A the area of the neck:

1. **Depth** (H-minima): a basin is none if m − s < ``depth`` voxels, which is what voxels make, or
   s > 0.9 m, which is what unevenness makes.
2. **Neck**, free of scale, the widest first: two basins are one grain if

       κ = s² A / (π m⁴) ≥ ``oneness``.

   A s² goes as the second moment of the neck's section, so κ compares the stiffness of the neck in bending
   with that of the smaller basin's thickest round section: two halves of one grain give about 1 or
   more, however flat or long it is, two grains that touch much less.

Then the labels grow from the cores into all voxels above the threshold, bright ones first.

Soille (2003) for the watershed on distances; `docs/decisions/0002-segmentation.md` for the measure.
"""

from __future__ import annotations

import edt
import numpy as np
from numpy.typing import NDArray
from pydantic.dataclasses import dataclass
from scipy import ndimage
from skimage.filters import threshold_otsu
from skimage.segmentation import watershed

from grainmotion._typing import Progress
from grainmotion.errors import InputError
from grainmotion.model.volume import Volume
from grainmotion.segmentation.region_merging import BasinGraph, renumbered
from grainmotion.segmentation.settings import SegmentSettings

Ints = NDArray[np.int32]
Bools = NDArray[np.bool_]

CORE = 0.75  # level of the cores: 0 is the mean outside the grains, 1 the grain's own attenuation around
AROUND = 9  # voxels along the edge of the cube over which a grain's own attenuation is averaged
TOGETHER = 0.65  # of the neighbours of a voxel that Otsu finds are found too; below that it finds noise
RARE = 1e-4  # share of voxels above Otsu's threshold below which they are hot voxels, not grains
SMALL = 0.02  # of the median grain's volume: the smallest grain, unless given
SPECK = 30  # voxels: what is smaller is no grain in any case


@dataclass(frozen=True, config={"arbitrary_types_allowed": True})
class Segmentation:
    """Where the grains are.

    Attributes
    ----------
    labels : (nz, ny, nx) int32 array
        0 for no grain, 1 … n for the grains.
    threshold : float
        Attenuation used, 1/mm.
    border : tuple of int
        Labels that touch the border of the field of view, and so may be incomplete.
    """

    labels: Ints
    threshold: float
    border: tuple[int, ...]


def segment(
    volume: Volume, settings: SegmentSettings | None = None, *, progress: Progress | None = None
) -> Segmentation:
    """Find the grains of a volume.

    Parameters
    ----------
    volume : Volume
        Attenuation, 1/mm.
    settings : SegmentSettings, optional
    progress : callable, optional
        Called as ``progress(message, done, total)``.

    Returns
    -------
    Segmentation

    Raises
    ------
    InputError
        If no grain is found.
    """
    settings = settings or SegmentSettings()

    def tell(message: str, done: int) -> None:
        if progress is not None:
            progress(message, done, 4)

    tell("threshold", 0)
    threshold = _threshold(volume, settings)
    speck = min(settings.min_volume or SPECK, SPECK)
    solid = _filled(volume.array > threshold)
    labels = np.zeros(volume.shape, np.int32)
    box = _bounds(solid)
    if box is not None:
        array, solid = volume.array[box], solid[box]
        if settings.threshold is None and _togetherness(solid) < TOGETHER:
            fact = f"no grains found: what lies above {threshold:.4g} 1/mm is scattered like noise"
            raise InputError("segment.threshold", fact, "give a threshold, or check the scan")
        tell("distances and watershed", 1)
        distance = edt.edt(_cores(array, solid, threshold), parallel=1)
        basins = _basins(distance)
        tell("which basins are one grain", 2)
        cores = BasinGraph.of(distance, basins).joined(settings.depth, settings.oneness)[basins]
        tell("small objects", 3)
        grown = watershed(-array, _at_least(cores, speck), mask=solid)
        labels[box] = _kept(grown, settings.min_volume)
    if labels.max() == 0:
        raise InputError(
            "segment.threshold", f"no grains found above {threshold:.4g} 1/mm", "lower it, or lower segment.min_volume"
        )
    tell(f"{labels.max()} grains", 4)
    return Segmentation(labels, threshold, border_labels(labels))


def border_labels(labels: NDArray[np.integer]) -> tuple[int, ...]:
    """Labels that touch a face of the array, or the border of its inscribed upright cylinder."""
    _, ny, nx = labels.shape
    edge = np.zeros(labels.shape, dtype=bool)
    edge[[0, -1]] = edge[:, [0, -1]] = edge[:, :, [0, -1]] = True
    y, x = np.arange(ny) - (ny - 1) / 2, np.arange(nx) - (nx - 1) / 2
    edge[:, np.hypot(y[:, None], x[None, :]) > min(ny, nx) / 2 - 1.5] = True
    return tuple(int(i) for i in np.unique(labels[edge]) if i)


def _threshold(volume: Volume, settings: SegmentSettings) -> float:
    array = volume.array
    if array.max() <= array.min():
        raise InputError("segment.threshold", "no grains found: the volume is uniform", "check the volume")
    if settings.threshold is not None:
        return settings.threshold
    threshold = float(threshold_otsu(array))
    while np.count_nonzero(array > threshold) < RARE * array.size:
        array = np.minimum(array, np.float32(threshold))
        threshold = float(threshold_otsu(array))
    return threshold


def _filled(solid: Bools) -> Bools:
    """The same with its cavities filled: what is empty and does not reach a face of the array."""
    empty, n = ndimage.label(~solid)
    outside = np.zeros(n + 1, dtype=bool)
    for axis in range(3):
        faces = np.take(empty, [0, -1], axis=axis)
        outside[np.unique(faces)] = True
    outside[0] = False
    return ~outside[empty]


def _togetherness(solid: Bools) -> float:
    """Share of solid voxels among the six neighbours of a solid voxel; a half-full box of noise has a half."""
    links = sum(np.count_nonzero(np.diff(solid, axis=axis)) for axis in range(3))  # solid beside empty
    return 1 - links / (6 * np.count_nonzero(solid))


def _bounds(solid: Bools) -> tuple[slice, slice, slice] | None:
    """The smallest box around it, and one voxel more; None if there is nothing."""
    box = []
    for axis in range(3):
        there = np.flatnonzero(solid.any(axis=tuple({0, 1, 2} - {axis})))
        if len(there) == 0:
            return None
        box.append(slice(max(int(there[0]) - 1, 0), int(there[-1]) + 2))
    return box[0], box[1], box[2]


def _cores(array: NDArray[np.float32], solid: Bools, threshold: float) -> Bools:
    """Voxels at `CORE` of their grain's own attenuation; never lower than the threshold.

    A grain fainter than the rest has a lower level; inclusions brighter than the rest raise none.
    """
    bright = float(np.median(array[solid]))
    outside = array[~solid]
    dark = float(outside.mean()) if outside.size else 0.0
    inner = ndimage.binary_erosion(solid)
    weight = ndimage.uniform_filter(inner.astype(np.float32), AROUND)
    own = ndimage.uniform_filter(np.where(inner, np.minimum(array, bright), 0).astype(np.float32), AROUND)
    known = weight > 1 / AROUND**3
    own = np.where(known, own / np.where(known, weight, 1), bright)
    cores = _filled(solid & (array > np.maximum(threshold, dark + CORE * (own - dark))))
    pieces, n = ndimage.label(solid)  # a piece too thin or too faint for a core is its own
    without = np.ones(n + 1, dtype=bool)
    without[pieces[cores]] = False
    without[0] = False
    return cores | without[pieces]


def _basins(distance: NDArray[np.float32]) -> Ints:
    """Watershed from every local maximum of the distance."""
    inside = distance > 0
    peaks = (distance == ndimage.maximum_filter(distance, size=3)) & inside
    seeds, _ = ndimage.label(peaks, np.ones((3, 3, 3)))
    return watershed(-distance, seeds, mask=inside).astype(np.int32)


def _at_least(labels: Ints, least: int) -> Ints:
    """Labels without those of fewer voxels, numbered 1 … n."""
    sizes = np.bincount(labels.ravel())
    sizes[0] = 0
    return renumbered(np.where(sizes >= least, np.arange(len(sizes)), 0))[labels]


def _kept(labels: Ints, min_volume: int | None) -> Ints:
    """Labels without the small objects, numbered 1 … n."""
    if min_volume is None:
        sizes = np.bincount(labels.ravel())[1:]
        min_volume = max(SPECK, int(SMALL * np.median(sizes))) if len(sizes) else SPECK
    return _at_least(labels, min_volume)
