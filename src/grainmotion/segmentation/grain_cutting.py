"""Grains cut from a labelled volume, each with its own voxels, on the volume's and on finer ones.

A grain depends on the voxels and labels around it alone, so that grains are cut one by one, by all threads or by
workers, and neither grown labels nor finer voxels are ever made of the whole volume.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from grainmotion.kernels.layout import PADDING
from grainmotion.model.compact_volume import CompactVolume
from grainmotion.model.grains import Grain
from grainmotion.model.thread_map import made_by_threads
from grainmotion.model.volume import Volume
from grainmotion.segmentation.label_growth import grown_crop
from grainmotion.segmentation.label_refinement import Box, fine_cut, placed, surroundings, widened

Boxed = tuple[int, tuple[slice, ...]]
"""A label and its bounding box."""


@dataclass(frozen=True)
class CutSettings:
    """How grains are cut.

    Attributes
    ----------
    reach : float
        Distance up to which voxels without a label belong to the nearest one, voxels.
    upsampling : int
        Edge of a voxel over that of the finer ones; 1 for none.
    compact : bool
        Whether the grains' voxels are kept as `CompactVolume`.
    """

    reach: float
    upsampling: int = 1
    compact: bool = False


Cut = Callable[[Volume, NDArray[np.integer], list[Boxed], CutSettings], Iterable[Grain | None]]
"""Cuts grains, as `cut_grains`."""


def cut_grains(
    volume: Volume, labels: NDArray[np.integer], boxes: list[Boxed], settings: CutSettings
) -> Iterator[Grain | None]:
    """The grains of labels, one after the other, by all threads.

    Parameters
    ----------
    volume : Volume
        Attenuation, 1/mm.
    labels : (nz, ny, nx) int array
        Labels of grains and bodies, 0 for none.
    boxes : list of (int, slices)
        Labels of the wanted grains and the bounding boxes of these labels.
    settings : CutSettings
        How they are cut.

    Yields
    ------
    Grain or None
        None if the label holds no attenuation.
    """

    def cut(boxed: Boxed) -> Grain | None:
        label, box = boxed
        around = needed(box, volume.shape, settings)
        crop = placed_crop(volume.array[around], volume.origin, volume.voxel_size, around)
        return cut_grain(crop, labels[around], label, settings)

    return made_by_threads(cut, boxes)


def needed(box: tuple[slice, ...], shape: tuple[int, ...], settings: CutSettings) -> Box:
    """The part of a volume on which the grain of a label in a box depends."""
    steps = int(settings.reach)
    grown = widened(box, shape, steps)
    return widened(surroundings(grown, shape, settings.reach), shape, steps)


def placed_crop(
    array: NDArray[np.floating], origin: NDArray[np.float64], voxel_size: float, box: tuple[slice, ...]
) -> Volume:
    """The voxels in a box of a volume, in their place in the sample frame; ``origin`` is that of the volume."""
    first = origin + voxel_size * np.array([s.start for s in box[::-1]])
    x, y, z = first + voxel_size * (np.array(array.shape[::-1]) - 1) / 2
    return Volume(array, voxel_size, (float(x), float(y), float(z)))


def cut_grain(around: Volume, labels: NDArray[np.integer], label: int, settings: CutSettings) -> Grain | None:
    """One grain, from what is `needed` of the volume and its labels."""
    whole = np.ascontiguousarray(labels, np.int32)
    steps = int(settings.reach)
    wide = surroundings(widened(_box_of(whole == label), whole.shape, steps), whole.shape, settings.reach)
    grown = grown_crop(whole, settings.reach, wide)
    origin, size = around.origin, around.voxel_size
    around, near = placed_crop(around.array[wide], origin, size, wide), whole[wide]
    box = _box_of(grown == label)
    own = np.where(grown[box] == label, around.array[box], 0)
    mass = float(own.sum(dtype=float))
    if mass <= 0:
        return None
    volume = _padded(placed_crop(own, around.origin, size, box))
    fine = None
    if settings.upsampling > 1:
        crop = surroundings(box, around.shape, settings.reach)
        arrays = around.array[crop], near[crop], grown[crop]
        cut = fine_cut(*arrays, label, settings.upsampling, settings.reach)
        fine = None if cut is None else _padded(placed(cut, around, crop, settings.upsampling))
    center = _centre_of_mass(volume, mass)
    if not settings.compact:
        return Grain(label, volume, center, fine=fine)
    return Grain(label, CompactVolume.of(volume), center, fine=None if fine is None else CompactVolume.of(fine))


def _box_of(mask: NDArray[np.bool_]) -> Box:
    """The box of the voxels of a mask, which holds at least one."""
    z, y, x = (np.flatnonzero(mask.any(axis=axes)) for axes in ((1, 2), (0, 2), (0, 1)))
    return slice(z[0], z[-1] + 1), slice(y[0], y[-1] + 1), slice(x[0], x[-1] + 1)


def _padded(volume: Volume) -> Volume:
    """The volume with `PADDING` empty voxels around it."""
    return Volume(np.pad(volume.array, PADDING), volume.voxel_size, volume.center)


def _centre_of_mass(volume: Volume, mass: float) -> NDArray[np.float64]:
    """Centre of the attenuation, mm, x y z."""
    array, planes = volume.array, {0, 1, 2}
    sums = [array.sum(axis=tuple(planes - {k}), dtype=float) @ np.arange(array.shape[k]) for k in (2, 1, 0)]
    return np.asarray(volume.origin + volume.voxel_size * np.array(sums, float) / mass)
