"""Segmentation of a volume into grains: phases, then the grains of each, then which of these are bodies.

Where all that attenuates is of one material, Otsu's threshold separates it from air.  A liquid, a second material and
a piston are levels of their own (`phases`).  Grains of a level that touch are separated by the shape of their cores
(`separation`), and labels that are far larger or thinner than the others are pistons, walls and wires (`large_bodies`).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from pydantic.dataclasses import dataclass
from scipy import ndimage
from skimage.filters import threshold_otsu

from grainmotion._arguments import checked_arguments
from grainmotion._typing import Progress
from grainmotion.errors import InputError
from grainmotion.model.summary import Summarised, Summary, names_text, shape_text
from grainmotion.model.thumbnails import grey_picture, thinned_image
from grainmotion.model.volume import Volume
from grainmotion.segmentation.border import beyond_field, border_labels, cut_labels
from grainmotion.segmentation.by_level import Pieces
from grainmotion.segmentation.labels import checked_labels
from grainmotion.segmentation.large_bodies import large_bodies
from grainmotion.segmentation.phases import Levels, Phase, PhaseMap, find_levels
from grainmotion.segmentation.separation import large_enough, separated
from grainmotion.segmentation.settings import SegmentSettings

Ints = NDArray[np.int32]
Bools = NDArray[np.bool_]

MIN_SOLID_NEIGHBOURS = 0.65
"""Share of a solid voxel's neighbours that are solid; below it Otsu's threshold separates noise."""
MIN_SOLID_SHARE = 1e-4
"""Share of all voxels above Otsu's threshold; fewer are hot voxels, not grains."""
PROGRESS_STEPS = 4


@dataclass(frozen=True, repr=False, config={"arbitrary_types_allowed": True})
class Segmentation(Summarised):
    """Labels of the grains of a volume.

    Attributes
    ----------
    labels : (nz, ny, nx) int32 array
        0 for no grain, 1 … n for the grains.
    threshold : float
        Attenuation from which a voxel is grain, 1/mm.
    border : tuple of int
        Labels that touch the border of the field of view, and so may be incomplete.
    phases : tuple of Phase
        What was found: air, liquid, grains and bodies; empty if the labels were given.

    Examples
    --------
    >>> segmentation = gm.segment(volume)
    >>> int(segmentation.labels.max())
    4
    """

    labels: Ints
    threshold: float
    border: tuple[int, ...]
    phases: tuple[Phase, ...] = ()

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

    def _summary(self) -> Summary:
        rows = [("labels", f"{shape_text(self.labels.shape)} voxels (z, y, x)")]
        rows += [("threshold", f"{self.threshold:.4g} 1/mm")] if np.isfinite(self.threshold) else []
        rows += [("at the border", names_text([str(label) for label in self.border]))] if self.border else []
        rows += [
            (f"phase: {p.kind}", f"{p.attenuation:.4g} 1/mm, {100 * p.share:.3g} % of the voxels") for p in self.phases
        ]
        thinned = thinned_image(self.labels[self.labels.shape[0] // 2])
        picture = grey_picture(np.where(thinned > 0, 1 + thinned * 7 % 10, 0), upwards=True)
        return Summary("Segmentation", ", ".join(f"{name} {value}" for name, value in rows[:2]), tuple(rows), picture)


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
        ``threshold``, ``depth``, ``oneness``, ``min_volume`` and ``phases`` count here, the others in `extract_grains`.
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

    Examples
    --------
    >>> segmentation = gm.segment(volume)
    >>> int(segmentation.labels.max()), segmentation.border
    (4, ())
    """
    settings = settings or SegmentSettings()

    def report(message: str, done: int) -> None:
        if progress is not None:
            progress(message, done, PROGRESS_STEPS)

    report("threshold", 0)
    threshold = _threshold(volume, settings)
    solid = ndimage.binary_fill_holes(volume.array > threshold)
    if settings.threshold is None and solid.any() and _solid_neighbours(solid) < MIN_SOLID_NEIGHBOURS:
        fact = f"no grains found: what lies above {threshold:.4g} 1/mm is scattered like noise"
        raise InputError("segment.threshold", fact, "give a threshold, or check the scan")
    report("phases", 1)
    levels = None
    if min(volume.shape) > 1 and (settings.phases or settings.threshold is None):
        levels = find_levels(volume.array, threshold, settings.phases, beyond_field(volume))
    report("distances and watershed", 2)
    labels = None
    if levels is not None:
        pieces = Pieces.of(volume.array, levels, settings)
        if settings.phases or not pieces.fit_one_threshold(levels, threshold):
            labels, threshold = pieces.labels, levels.half_way(pieces.level_of[1:])
    if labels is None:
        labels = large_enough(separated(volume.array, solid, threshold, settings), settings)[0]
    report("bodies", 3)
    labels = _without_bodies(labels, settings)
    if labels.max() == 0:
        raise InputError(
            "segment.threshold", f"no grains found above {threshold:.4g} 1/mm", "lower it, or lower segment.min_volume"
        )
    phases = _phases(volume.array, threshold, levels, labels)
    beside = [str(phase) for phase in phases if phase.kind in ("liquid", "body")]
    report(", ".join([f"{labels.max()} grains", *beside]), PROGRESS_STEPS)
    return Segmentation(labels, threshold, cut_labels(labels, volume), phases)


def _without_bodies(labels: Ints, settings: SegmentSettings) -> Ints:
    """Labels of the grains only."""
    bodies = large_bodies(labels)
    if not bodies:
        return labels
    return large_enough(np.where(np.isin(labels, bodies), 0, labels), settings)[0]


def _phases(array: NDArray[np.float32], threshold: float, levels: Levels | None, labels: Ints) -> tuple[Phase, ...]:
    """What was found."""
    if levels is None:
        values = np.array([np.median(array[labels == 0]) if (labels == 0).any() else 0.0, np.median(array[labels > 0])])
        levels = Levels(values, ("air", "solid"), (array > threshold).astype(np.int8))
    return PhaseMap.of(array, levels, labels).phases


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
