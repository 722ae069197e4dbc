"""Segmentation of a volume into grains: threshold, distance transform, watershed, merging of basins.

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

Then the labels grow from the cores into all voxels above the threshold, bright ones first.

Soille (2003) for the watershed of distances; `docs/decisions/0002-segmentation.md` for the criterion.
"""

from __future__ import annotations

import edt
import numpy as np
from numpy.typing import NDArray
from pydantic.dataclasses import dataclass
from scipy import ndimage
from skimage.filters import threshold_otsu
from skimage.segmentation import relabel_sequential, watershed

from grainmotion._arguments import checked_arguments
from grainmotion._typing import Progress
from grainmotion.errors import InputError
from grainmotion.model.volume import Volume
from grainmotion.segmentation.labels import checked_labels
from grainmotion.segmentation.region_merging import BasinGraph
from grainmotion.segmentation.settings import SegmentSettings

Ints = NDArray[np.int32]
Bools = NDArray[np.bool_]

CORE_LEVEL = 0.75
"""Level of the cores: 0 is the mean outside the grains, 1 the grain's own attenuation nearby."""
CORE_WINDOW = 9
"""Edge of the cube over which a grain's own attenuation is averaged, voxels."""
MIN_SOLID_NEIGHBOURS = 0.65
"""Share of a solid voxel's neighbours that are solid; below it Otsu's threshold separates noise."""
MIN_SOLID_SHARE = 1e-4
"""Share of all voxels above Otsu's threshold; fewer are hot voxels, not grains."""
MIN_GRAIN_SHARE = 0.02
"""Smallest grain unless given, over the median grain's volume."""
MIN_GRAIN_VOXELS = 30
"""Smallest grain in any case, voxels."""
PROGRESS_STEPS = 4


@dataclass(frozen=True, config={"arbitrary_types_allowed": True})
class Segmentation:
    """Labels of the grains of a volume.

    Attributes
    ----------
    labels : (nz, ny, nx) int32 array
        0 for no grain, 1 … n for the grains.
    threshold : float
        Attenuation from which a voxel is grain, 1/mm.
    border : tuple of int
        Labels that touch the border of the field of view, and so may be incomplete.
    """

    labels: Ints
    threshold: float
    border: tuple[int, ...]

    @classmethod
    def of(cls, labels: NDArray[np.integer]) -> Segmentation:
        """A segmentation from given labels, without a threshold.

        Parameters
        ----------
        labels : (nz, ny, nx) int32 array
            0 for no grain.

        Returns
        -------
        Segmentation
            With the labels that touch the border of the array.

        Raises
        ------
        InputError
            If they are not integers from 0 on in three dimensions.
        """
        return cls(checked_labels(labels).astype(np.int32, copy=False), float("nan"), border_labels(labels))


@checked_arguments
def segment(
    volume: Volume, settings: SegmentSettings | None = None, *, progress: Progress | None = None
) -> Segmentation:
    """Find the grains of a volume.

    Parameters
    ----------
    volume : Volume
        Attenuation, 1/mm.
    settings : SegmentSettings, optional
        ``threshold``, ``depth``, ``oneness`` and ``min_volume`` count here, the others in `extract_grains`.
    progress : callable, optional
        Called as ``progress(message, done, total)``.

    Returns
    -------
    Segmentation
        Labels on the volume's voxels.

    Raises
    ------
    InputError
        If no grain is found.
    """
    settings = settings or SegmentSettings()

    def report(message: str, done: int) -> None:
        if progress is not None:
            progress(message, done, PROGRESS_STEPS)

    report("threshold", 0)
    threshold = _threshold(volume, settings)
    smallest = min(settings.min_volume or MIN_GRAIN_VOXELS, MIN_GRAIN_VOXELS)
    solid = ndimage.binary_fill_holes(volume.array > threshold)
    labels = np.zeros(volume.shape, np.int32)
    box = _bounding_box(solid)
    if box is not None:
        array, solid = volume.array[box], solid[box]
        if settings.threshold is None and _solid_neighbours(solid) < MIN_SOLID_NEIGHBOURS:
            fact = f"no grains found: what lies above {threshold:.4g} 1/mm is scattered like noise"
            raise InputError("segment.threshold", fact, "give a threshold, or check the scan")
        report("distances and watershed", 1)
        distance = edt.edt(_cores(array, solid, threshold), parallel=1)
        basins = distance_basins(distance)
        report("merging of basins", 2)
        cores = BasinGraph.of(distance, basins).merged(settings.depth, settings.oneness)[basins]
        report("small objects", 3)
        grown = watershed(-array, _without_small(cores, smallest), mask=solid)
        labels[box] = _without_small(grown, settings.min_volume or _smallest_grain(grown))
    if labels.max() == 0:
        raise InputError(
            "segment.threshold", f"no grains found above {threshold:.4g} 1/mm", "lower it, or lower segment.min_volume"
        )
    report(f"{labels.max()} grains", PROGRESS_STEPS)
    return Segmentation(labels, threshold, border_labels(labels))


def border_labels(labels: NDArray[np.integer]) -> tuple[int, ...]:
    """Labels that touch a face of the array, or the side of its inscribed upright cylinder."""
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
    while np.count_nonzero(array > threshold) < MIN_SOLID_SHARE * array.size:  # hot voxels: clip them
        array = np.minimum(array, np.float32(threshold))
        threshold = float(threshold_otsu(array))
    return threshold


def _solid_neighbours(solid: Bools) -> float:
    """Share of solid voxels among the six neighbours of a solid voxel: 0.5 for noise that fills half of the volume."""
    faces = sum(np.count_nonzero(np.diff(solid, axis=axis)) for axis in range(3))  # between solid and empty
    return 1 - faces / (6 * np.count_nonzero(solid))


def _bounding_box(solid: Bools) -> tuple[slice, slice, slice] | None:
    """The smallest box that holds all solid voxels, and one voxel more on each side; None without any."""
    box = []
    for axis in range(3):
        layers = np.flatnonzero(solid.any(axis=tuple({0, 1, 2} - {axis})))
        if len(layers) == 0:
            return None
        box.append(slice(max(int(layers[0]) - 1, 0), int(layers[-1]) + 2))
    return box[0], box[1], box[2]


def _cores(array: NDArray[np.float32], solid: Bools, threshold: float) -> Bools:
    """Voxels above `CORE_LEVEL` of their grain's own attenuation and above the threshold.

    A grain fainter than the others has a lower level; inclusions brighter than the others do not raise it.
    """
    bright = float(np.median(array[solid]))
    outside = array[~solid]
    dark = float(outside.mean()) if outside.size else 0.0
    inner = ndimage.binary_erosion(solid)
    weight = ndimage.uniform_filter(inner.astype(np.float32), CORE_WINDOW)
    own = ndimage.uniform_filter(np.where(inner, np.minimum(array, bright), 0).astype(np.float32), CORE_WINDOW)
    averaged = weight > 1 / CORE_WINDOW**3
    own = np.where(averaged, own / np.where(averaged, weight, 1), bright)
    cores = ndimage.binary_fill_holes(solid & (array > np.maximum(threshold, dark + CORE_LEVEL * (own - dark))))
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


def _without_small(labels: Ints, smallest: int) -> Ints:
    """Labels of at least ``smallest`` voxels, numbered 1 … n.

    `skimage.morphology.remove_small_objects` takes three times as long, and warns of a volume with one grain.
    """
    sizes = np.bincount(labels.ravel())
    sizes[0] = 0
    numbers = relabel_sequential(np.where(sizes >= smallest, np.arange(len(sizes)), 0))[0]
    return np.asarray(numbers, np.int32)[labels]


def _smallest_grain(labels: Ints) -> int:
    """Smallest grain if none is given, voxels."""
    sizes = np.bincount(labels.ravel())[1:]
    return max(MIN_GRAIN_VOXELS, int(MIN_GRAIN_SHARE * np.median(sizes))) if len(sizes) else MIN_GRAIN_VOXELS
