"""Segmentation of a volume into grains: phases, then the grains of each, then which of these are bodies.

Where all that attenuates is of one material, Otsu's threshold separates it from air.  A liquid, a second material and
a piston are levels of their own (`phases`).  Grains of a level that touch are separated by the shape of their cores
(`separation`), and labels that are far larger or thinner than the others are pistons, walls and wires (`large_bodies`).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from pydantic.dataclasses import dataclass
from skimage.filters import threshold_otsu

from grainmotion._arguments import checked_arguments
from grainmotion._typing import Progress
from grainmotion.errors import InputError
from grainmotion.kernels.value_histogram import count_equal_bins
from grainmotion.model.large_arrays import large_empty
from grainmotion.model.summary import Summarised, Summary, names_text, shape_text
from grainmotion.model.thumbnails import grey_picture, thinned_image
from grainmotion.model.volume import Volume
from grainmotion.segmentation.blocks import Work, chunks_of, slabs_of
from grainmotion.segmentation.border import beyond_field, border_labels, cut_labels
from grainmotion.segmentation.by_level import Pieces
from grainmotion.segmentation.components import fill_holes
from grainmotion.segmentation.heights import Heights
from grainmotion.segmentation.label_measures import highest_label, renumber
from grainmotion.segmentation.labels import checked_labels
from grainmotion.segmentation.large_bodies import large_bodies
from grainmotion.segmentation.percentiles import median
from grainmotion.segmentation.phases import Levels, Phase, find_levels, phase_map
from grainmotion.segmentation.separation import large_enough, separated
from grainmotion.segmentation.settings import SegmentSettings

Ints = NDArray[np.int32]
Bools = NDArray[np.bool_]

MIN_SOLID_NEIGHBOURS = 0.65
"""Share of a solid voxel's neighbours that are solid; below it Otsu's threshold separates noise."""
MIN_SOLID_SHARE = 1e-4
"""Share of all voxels above Otsu's threshold; fewer are hot voxels, not grains."""
OTSU_BINS = 256
"""Bins of the histogram from which Otsu's threshold is taken."""


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
    settings, work = settings or SegmentSettings(), Work(progress)
    work.begin("threshold", 10, 5)
    threshold = _threshold(volume, settings, work)
    solid = _above(volume.array, threshold, work)
    if settings.threshold is None and solid.any() and _solid_neighbours(solid, work) < MIN_SOLID_NEIGHBOURS:
        fact = f"no grains found: what lies above {threshold:.4g} 1/mm is scattered like noise"
        raise InputError("segment.threshold", fact, "give a threshold, or check the scan")
    del solid  # found again where one threshold is enough
    work.begin("phases", 40, 14)
    levels, blurred = None, False
    if min(volume.shape) > 1 and (settings.phases or settings.threshold is None):
        levels, blurred = find_levels(volume.array, threshold, settings.phases, beyond_field(volume), work)
    work.begin("distances and watershed", 85, 32)
    labels = None
    if levels is not None:
        pieces = Pieces.of(volume.array, levels, settings, work)
        if settings.phases or not pieces.fit_one_threshold(levels, threshold):
            labels, threshold = pieces.labels, levels.half_way(pieces.level_of[1:])
    if labels is None:
        solid = _above(volume.array, threshold, work)
        labels = separated(Heights.of(volume.array, blurred), solid, threshold, settings, work)
        del solid
        large_enough(labels, settings, work)
    work.begin("bodies", 99, 12)
    _take_out_bodies(labels, settings, work)
    if highest_label(labels, work) == 0:
        raise InputError(
            "segment.threshold", f"no grains found above {threshold:.4g} 1/mm", "lower it, or lower segment.min_volume"
        )
    phases = _phases(volume.array, threshold, levels, labels, work)
    cut = cut_labels(labels, volume, work)
    beside = [str(phase) for phase in phases if phase.kind in ("liquid", "body")]
    work.end(", ".join([f"{highest_label(labels, work)} grains", *beside]))
    return Segmentation(labels, threshold, cut, phases)


def _take_out_bodies(labels: Ints, settings: SegmentSettings, work: Work) -> None:
    """Keep the labels of the grains only."""
    bodies = large_bodies(labels, work)
    if bodies:
        kept = np.arange(highest_label(labels, work) + 1, dtype=np.int32)
        kept[list(bodies)] = 0
        renumber(labels, kept, work)
        large_enough(labels, settings, work)


def _phases(
    array: NDArray[np.floating], threshold: float, levels: Levels | None, labels: Ints, work: Work
) -> tuple[Phase, ...]:
    """What was found."""
    if levels is None:
        around = median(work, array, labels, 0)
        values = np.array([around if np.isfinite(around) else 0.0, median(work, array, labels)])
        of_voxel = large_empty(array.shape, np.int8)
        work.each(
            slabs_of(array.shape), lambda slab: np.greater(array[slice(*slab)], threshold, of_voxel[slice(*slab)])
        )
        levels = Levels(values, ("air", "solid"), of_voxel)
    return phase_map(array, levels, labels, work).phases


def _threshold(volume: Volume, settings: SegmentSettings, work: Work) -> float:
    flat = volume.array.reshape(-1)
    chunks = chunks_of(flat.size)
    low, high = (float(f(v)) for f, v in zip((min, max), zip(*work.each(chunks, lambda c: _ends(flat[c])))))
    if high <= low:
        raise InputError("segment.threshold", "no grains found: the volume is uniform", "check the volume")
    if settings.threshold is not None:
        return settings.threshold
    while True:
        threshold = _otsu(flat, low, high, work)
        if _voxels_above(flat, threshold, work) >= MIN_SOLID_SHARE * flat.size:
            return threshold
        high = threshold  # hot voxels: they count as this much


def _voxels_above(flat: NDArray[np.floating], threshold: float, work: Work) -> int:
    return sum(work.each(chunks_of(flat.size), lambda part: int(np.count_nonzero(flat[part] > threshold))))


def _ends(values: NDArray[np.floating]) -> tuple[float, float]:
    return float(values.min()), float(values.max())


def _otsu(flat: NDArray[np.floating], low: float, high: float, work: Work) -> float:
    """Otsu's threshold of values, those above ``high`` clipped."""
    edges = np.histogram_bin_edges(np.array([low, high], flat.dtype), OTSU_BINS)

    def add(part: slice, counts: NDArray[np.int64]) -> NDArray[np.int64]:
        count_equal_bins(flat[part], edges, edges[-1], counts)
        return counts

    counts = sum(work.gathered(chunks_of(flat.size), lambda: np.zeros(OTSU_BINS, np.int64), add))
    return float(threshold_otsu(hist=(counts, (edges[:-1] + edges[1:]) / 2)))


def _above(array: NDArray[np.floating], threshold: float, work: Work) -> Bools:
    """Voxels above a threshold, and what they enclose."""
    solid = large_empty(array.shape, bool)
    work.each(slabs_of(array.shape), lambda slab: np.greater(array[slice(*slab)], threshold, solid[slice(*slab)]))
    fill_holes(solid, work)
    return solid


def _solid_neighbours(solid: Bools, work: Work) -> float:
    """Share of solid voxels among the six neighbours of a solid voxel: 0.5 for noise that fills half of the volume."""

    def count(slab: tuple[int, int]) -> tuple[int, int]:
        own, wide = solid[slice(*slab)], solid[slab[0] : slab[1] + 1]
        faces = np.count_nonzero(wide[1:] != wide[:-1])  # between solid and empty
        faces += np.count_nonzero(own[:, 1:] != own[:, :-1]) + np.count_nonzero(own[..., 1:] != own[..., :-1])
        return int(faces), int(np.count_nonzero(own))

    faces, voxels = np.sum(work.each(slabs_of(solid.shape), count), axis=0)
    return float(1 - faces / (6 * voxels))
