"""Grains extracted from a labelled volume: each with its own voxels."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from skimage.segmentation import expand_labels

from grainmotion.errors import InputError
from grainmotion.kernels.layout import PADDING
from grainmotion.model.grains import Grain, GrainSet
from grainmotion.model.volume import Volume
from grainmotion.projection.grain_arrays import GrainArrays
from grainmotion.segmentation.label_refinement import Boxed, fine_grains
from grainmotion.segmentation.segment import Segmentation
from grainmotion.segmentation.settings import Background, SegmentSettings


def packed_body(background: Volume) -> GrainArrays:
    """A background as one body: turned about its centre of mass, without the empty voxels around it."""
    return GrainArrays.of(grains_from_labels(background, np.ones(background.shape, np.int8), reach=0))


Cut = Callable[[Volume, NDArray[np.integer], list[Boxed], int, float], Iterable[Volume | None]]
MUCH, BESIDE = 0.02, 1.5  # share of all attenuation; voxels
SMOOTHED, FAINT = 2.0, 0.02  # voxels; share of the grains' attenuation that tells a wall from noise


def extract_grains(
    volume: Volume, segmentation: Segmentation, settings: SegmentSettings | None = None, *, cut: Cut = fine_grains
) -> GrainSet:
    """Extract the grains of a segmented volume, as ``grainmotion run`` does.

    Parameters
    ----------
    volume : Volume
        Attenuation, 1/mm.
    segmentation : Segmentation
        Its labels, and those that the border of the field of view cuts.
    settings : SegmentSettings, optional
        ``reach``, ``background`` and ``finer`` decide what becomes of voxels without a label.
    cut : callable, optional
        Resamples grains on finer voxels, as `label_refinement.fine_grains`.

    Returns
    -------
    GrainSet
        What `track` takes.

    Raises
    ------
    InputError
        If the labels are not the volume's, or there is no grain.
    """
    settings = settings or SegmentSettings()
    return grains_from_labels(
        volume,
        segmentation.labels,
        reach=settings.reach,
        border=segmentation.border,
        background=settings.background,
        finer=settings.finer,
        cut=cut,
    )


def grains_from_labels(
    volume: Volume,
    labels: NDArray[np.integer],
    *,
    reach: float = 3.0,
    border: Collection[int] = (),
    background: Background = "auto",
    finer: int = 2,
    cut: Cut = fine_grains,
) -> GrainSet:
    """Cut a labelled volume into grains.

    Everything that attenuates must be somewhere (Σ μ⁽ⁱ⁾ = μ): voxels without a label, such as
    partial-volume surfaces, go to the nearest grain up to ``reach`` voxels away.

    Parameters
    ----------
    volume : Volume
        Attenuation, 1/mm.
    labels : (nz, ny, nx) int array
        0 is no grain; every other value is one grain.
    reach : float
        How far attenuation without a label is handed to the nearest grain, in voxels.
    border : collection of int
        Labels of grains that touch the border of the field of view.
    background : {"auto", "ignore", "fixed", "moving"}
        What becomes of attenuation further away (container, pistons, fines): dropped, kept where it is in all
        states, or moved as one body; "auto" moves it if it holds more than `MUCH` of all attenuation, and drops it
        if not.  What is kept takes all from `BESIDE` voxels on, so that no grain carries a piece of wall.
    finer : int
        Each grain is resampled, too, on voxels this many times finer, and parted from its neighbours there (see
        `partition`); 1 is none.  A slice one voxel thick is not.
    cut : callable, optional
        Who does that: as `label_refinement.fine_grains`.

    Returns
    -------
    GrainSet
        The grains, and the background if it is kept.

    Raises
    ------
    InputError
        If shapes differ, labels are not integers from 0 on, or there is no grain.
    """
    if not np.issubdtype(labels.dtype, np.integer):
        raise InputError("labels", f"they are {labels.dtype}", "give integers, 0 for no grain")
    if labels.shape != volume.shape:
        raise InputError("labels", f"shape {labels.shape} is not the volume's {volume.shape}", "give them on one grid")
    if labels.min() < 0 or labels.max() > labels.size:
        raise InputError("labels", f"they run from {labels.min()} to {labels.max()}", "number the grains from 1 on")
    grown = expand_labels(labels, distance=reach) if reach > 0 else labels
    if background == "auto":
        background = "moving" if min(volume.shape) > 1 and _rest(volume, labels, grown) > MUCH else "ignore"
    if background != "ignore" and reach > BESIDE:
        reach = BESIDE
        grown = expand_labels(labels, distance=reach)
    grains, wanted = [], []
    for index, box in enumerate(ndimage.find_objects(grown), start=1):
        if box is None:
            continue
        grain = _cut(volume, grown, index, box, index in border)
        if grain is not None:
            grains.append(grain)
            wanted.append((index, box))
    if finer > 1 and min(volume.shape) > 1:
        for k, fine in enumerate(cut(volume, labels, wanted, finer, reach)):
            grains[k] = grains[k] if fine is None else replace(grains[k], fine=padded(fine))
    if not grains:
        raise InputError("labels", "no grains found", "check the threshold, or the labels given")
    lay_together(grains)
    rest = None
    if background != "ignore":
        rest = Volume(np.where(grown > 0, 0, volume.array), volume.voxel_size, volume.center)
    return GrainSet(tuple(grains), rest, background == "moving")


def _rest(volume: Volume, labels: NDArray[np.integer], grown: NDArray[np.integer]) -> float:
    """Share of all attenuation that is no grain's, and no noise: it stands out of what is smoothed."""
    whole = float(volume.array.sum(dtype=float))
    grain = float(volume.array[labels > 0].mean()) if labels.any() else 0.0
    rest = ndimage.gaussian_filter(np.where(grown == 0, volume.array, 0), SMOOTHED)
    return float(rest[rest > FAINT * grain].sum(dtype=float)) / whole if whole > 0 else 0.0


def padded(volume: Volume) -> Volume:
    """The volume with `PADDING` empty voxels around it."""
    return Volume(np.pad(volume.array, PADDING), volume.voxel_size, volume.center)


def lay_together(grains: list[Grain]) -> None:
    """Move all voxels, in place, to one array (two, with finer ones), which tracking then uses as it is."""
    whole = [np.empty(sum(v.array.size for v in volumes), volumes[0].array.dtype) for volumes in _sets(grains)]
    ends = [0, 0]
    for k, grain in enumerate(grains):  # one after the other, so that what is copied is let go
        moved = []
        for which, volume in enumerate(v[0] for v in _sets([grain])):
            array, start = whole[which], ends[which]
            ends[which] += volume.array.size
            place = array[start : ends[which]].reshape(volume.shape)
            place[:] = volume.array
            moved.append(replace(volume, array=place))
        grains[k] = replace(grain, volume=moved[0], fine=moved[1] if len(moved) > 1 else grain.fine)


def _sets(grains: list[Grain]) -> list[list[Volume]]:
    """The grains' voxels, and their finer ones if all have some."""
    fine = [g.fine for g in grains if g.fine is not None]
    return [[g.volume for g in grains], *([fine] if len(fine) == len(grains) else [])]


def _cut(
    volume: Volume, labels: NDArray[np.integer], label: int, box: tuple[slice, ...], touches: bool
) -> Grain | None:
    mine = np.where(labels[box] == label, volume.array[box], 0)
    mass = float(mine.sum(dtype=float))
    if mass <= 0:
        return None
    array = np.pad(mine, PADDING)
    h = volume.voxel_size
    start = volume.origin + h * (np.array([s.start for s in box[::-1]]) - PADDING)
    middle = start + h * (np.array(array.shape[::-1]) - 1) / 2
    crop = Volume(array, h, (middle[0], middle[1], middle[2]))
    mean = [
        float((array.sum(axis=tuple({0, 1, 2} - {k}), dtype=float) * np.arange(array.shape[k])).sum())
        for k in (2, 1, 0)
    ]
    return Grain(label, crop, start + h * np.array(mean) / mass, touches)
