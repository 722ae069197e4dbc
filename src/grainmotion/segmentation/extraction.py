"""Grains extracted from a labelled volume: each with its own voxels."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Collection, Iterable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from skimage.segmentation import expand_labels

from grainmotion._arguments import checked_arguments
from grainmotion.errors import InputError
from grainmotion.kernels.layout import PADDING
from grainmotion.model.grains import Grain, GrainSet
from grainmotion.model.scene import NO_MOTION, RIGID_MOTION, Body, Scene
from grainmotion.model.volume import Volume
from grainmotion.projection.grain_arrays import GrainArrays
from grainmotion.segmentation.label_refinement import Boxed, fine_grains
from grainmotion.segmentation.labels import checked_labels, without_small_labels
from grainmotion.segmentation.segment import Segmentation
from grainmotion.segmentation.settings import Background, SegmentSettings

Cut = Callable[[Volume, NDArray[np.integer], list[Boxed], int, float], Iterable[Volume | None]]
"""Upsamples grains, as `label_refinement.fine_grains`."""
MIN_BACKGROUND_SHARE = 0.02
"""Share of all attenuation from which the background is kept."""
MAX_REACH_WITH_BACKGROUND = 1.5
"""Largest ``reach`` where there is a background, voxels."""
BACKGROUND_SIGMA = 2.0
"""Width of the Gaussian filter under which a background is distinguished from noise, voxels."""
MAX_LABELS_NAMED = 10
"""Labels that a warning lists."""
BACKGROUND_LEVEL = 0.02
"""Level from which filtered attenuation is background, over the mean of the grains."""


@checked_arguments
def extract_grains(
    volume: Volume, segmentation: Segmentation, settings: SegmentSettings | None = None, *, cut: Cut = fine_grains
) -> GrainSet:
    """Extract the grains of a segmented volume, as ``grainmotion run`` does.

    Parameters
    ----------
    volume : Volume
        Attenuation, 1/mm.
    segmentation : Segmentation
        Labels of the grains, and of those at the border of the field of view.
    settings : SegmentSettings, optional
        ``reach``, ``background`` and ``finer`` decide what becomes of voxels without a label.
    cut : callable, optional
        Upsamples the grains, as `label_refinement.fine_grains`.

    Returns
    -------
    GrainSet
        One grain a label that holds attenuation.

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


@checked_arguments
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
    """Extract the grains of a labelled volume.

    All attenuation must belong to some body (Σ μ⁽ⁱ⁾ = μ): voxels without a label, such as partial-volume
    surfaces, belong to the nearest grain up to ``reach`` voxels away.

    Parameters
    ----------
    volume : Volume
        Attenuation, 1/mm.
    labels : (nz, ny, nx) int array
        0 is no grain; every other value is one grain.
    reach : float
        Distance up to which attenuation without a label belongs to the nearest grain, voxels.
    border : collection of int
        Labels of grains that touch the border of the field of view.
    background : {"auto", "ignore", "fixed", "moving"}
        Attenuation further away (container, pistons, fines): ignored, fixed in all states, or moving as one body;
        "auto" is moving if it holds more than `MIN_BACKGROUND_SHARE` of all attenuation, else ignored.  A background
        begins `MAX_REACH_WITH_BACKGROUND` voxels from the labels, so that no grain carries a piece of wall.
    finer : int
        Factor by which each grain is upsampled as well, with refined boundaries (see `label_refinement`); 1 is none.
        A slice one voxel thick is not upsampled.
    cut : callable, optional
        Upsamples the grains, as `label_refinement.fine_grains`.

    Returns
    -------
    GrainSet
        The grains, one for each label that holds attenuation, and the background if it is kept.  Labels of fewer
        than `labels.MIN_LABEL_VOXELS` voxels are dropped, with a warning.

    Raises
    ------
    InputError
        If shapes differ, labels are not integers from 0 on, or there is no grain.
    """
    labels, small = without_small_labels(checked_labels(labels, volume.shape))
    if small:
        some = ", ".join(str(label) for label in small[:MAX_LABELS_NAMED])
        warnings.warn(f"{len(small)} labels of too few voxels are no grains: {some}", stacklevel=2)
    grown = expand_labels(labels, distance=reach) if reach > 0 else labels
    if background == "auto":
        kept = min(volume.shape) > 1 and _background_share(volume, labels, grown) > MIN_BACKGROUND_SHARE
        background = "moving" if kept else "ignore"
    if background != "ignore" and reach > MAX_REACH_WITH_BACKGROUND:
        reach = MAX_REACH_WITH_BACKGROUND
        grown = expand_labels(labels, distance=reach)
    grains, boxes = [], []
    for label, box in enumerate(ndimage.find_objects(grown), start=1):
        if box is None:
            continue
        grain = _extracted(volume, grown, label, box, label in border)
        if grain is not None:
            grains.append(grain)
            boxes.append((label, box))
    if finer > 1 and min(volume.shape) > 1:
        for k, fine in enumerate(cut(volume, labels, boxes, finer, reach)):
            grains[k] = grains[k] if fine is None else replace(grains[k], fine=padded(fine))
    if not grains:
        raise InputError("labels", "no grains found", "check the threshold, or the labels given")
    store_contiguously(grains)
    scene = Scene(field=volume.field)
    if background != "ignore":
        rest = volume.cropped(grown == 0)
        body = Body("rest", "rest", rest, RIGID_MOTION if background == "moving" else NO_MOTION)
        scene = Scene((body,), field=volume.field)
    return GrainSet(tuple(grains), scene)


def packed_body(background: Volume) -> GrainArrays:
    """A background as one body, which rotates about its centre of mass, cropped to its voxels."""
    return GrainArrays.of(grains_from_labels(background, np.ones(background.shape, np.int8), reach=0))


def _background_share(volume: Volume, labels: NDArray[np.integer], grown: NDArray[np.integer]) -> float:
    """Share of all attenuation that belongs to no grain and is no noise."""
    whole = float(volume.array.sum(dtype=float))
    grain = float(volume.array[labels > 0].mean()) if labels.any() else 0.0
    rest = ndimage.gaussian_filter(np.where(grown == 0, volume.array, 0), BACKGROUND_SIGMA)
    return float(rest[rest > BACKGROUND_LEVEL * grain].sum(dtype=float)) / whole if whole > 0 else 0.0


def padded(volume: Volume) -> Volume:
    """The volume with `PADDING` empty voxels around it."""
    return Volume(np.pad(volume.array, PADDING), volume.voxel_size, volume.center)


def store_contiguously(grains: list[Grain]) -> None:
    """Move the voxels of all grains, in place, to one array (and upsampled ones to another), as kernels need them."""
    arrays = [np.empty(sum(v.array.size for v in volumes), volumes[0].array.dtype) for volumes in _levels(grains)]
    ends = [0, 0]
    for k, grain in enumerate(grains):  # one by one, so that the memory of each is freed once it is copied
        moved = []
        for level, volume in enumerate(volumes[0] for volumes in _levels([grain])):
            start = ends[level]
            ends[level] += volume.array.size
            place = arrays[level][start : ends[level]].reshape(volume.shape)
            place[:] = volume.array
            moved.append(replace(volume, array=place))
        grains[k] = replace(grain, volume=moved[0], fine=moved[1] if len(moved) > 1 else grain.fine)


def _levels(grains: list[Grain]) -> list[list[Volume]]:
    """The volumes of all grains, and the upsampled ones if all grains have them."""
    fine = [g.fine for g in grains if g.fine is not None]
    return [[g.volume for g in grains], *([fine] if len(fine) == len(grains) else [])]


def _extracted(
    volume: Volume, labels: NDArray[np.integer], label: int, box: tuple[slice, ...], touches_border: bool
) -> Grain | None:
    """The grain of a label in its bounding box; None if it holds no attenuation."""
    own = np.where(labels[box] == label, volume.array[box], 0)
    mass = float(own.sum(dtype=float))
    if mass <= 0:
        return None
    array, voxel_size = np.pad(own, PADDING), volume.voxel_size
    start = volume.origin + voxel_size * (np.array([s.start for s in box[::-1]]) - PADDING)
    middle = start + voxel_size * (np.array(array.shape[::-1]) - 1) / 2
    crop = Volume(array, voxel_size, (middle[0], middle[1], middle[2]))
    moments = [
        float((array.sum(axis=tuple({0, 1, 2} - {k}), dtype=float) * np.arange(array.shape[k])).sum())
        for k in (2, 1, 0)
    ]
    return Grain(label, crop, start + voxel_size * np.array(moments) / mass, touches_border)
