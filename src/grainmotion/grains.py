"""Grain, GrainSet: the grains of the reference state, each with its own voxels."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from skimage.segmentation import expand_labels

from grainmotion.errors import InputError
from grainmotion.partition import Boxed, fine_grains
from grainmotion.volume import Volume

Background = Literal["auto", "ignore", "fixed", "moving"]
Cut = Callable[[Volume, NDArray[np.integer], list[Boxed], int, float], Iterable[Volume | None]]
MUCH, BESIDE = 0.02, 1.5  # share of all attenuation; voxels
SMOOTHED, FAINT = 2.0, 0.02  # voxels; share of the grains' attenuation that tells a wall from noise
PADDING = 2  # empty voxels kept around each grain, so that interpolation never leaves its crop


@dataclass(frozen=True, eq=False)
class Grain:
    """One grain in the reference state.

    Attributes
    ----------
    label : int
        Its label in the reference volume.
    volume : Volume
        Its own attenuation, cropped, zero in the outermost `PADDING` voxels.
    center : (3,) array
        Attenuation-weighted centre of mass c, mm, x y z: the centre of its rotations.
    touches_border : bool
        Whether it reaches the border of the reconstructed field of view, and so may be incomplete.
    fine : Volume, optional
        The same attenuation on finer voxels, for the last stages of tracking; padded as ``volume``.
    """

    label: int
    volume: Volume
    center: NDArray[np.float64]
    touches_border: bool = False
    fine: Volume | None = None


@dataclass(frozen=True, eq=False)
class GrainSet:
    """The grains of a sample, and what attenuates beside them.

    Attributes
    ----------
    grains : tuple of Grain
        All on the same voxel size.
    background : Volume, optional
        Attenuation that belongs to no grain (container, fines).
    background_moves : bool
        Whether it may move as one rigid body; else it stays where it is.

    Raises
    ------
    InputError
        If there is no grain, two have one label, or voxel sizes differ.
    """

    grains: tuple[Grain, ...]
    background: Volume | None = None
    background_moves: bool = False

    def __post_init__(self) -> None:
        if not self.grains:
            raise InputError("grains", "there is no grain", "give at least one")
        labels, counts = np.unique(self.labels, return_counts=True)
        if counts.max() > 1:
            raise InputError("grains", f"label {labels[counts.argmax()]} is there twice", "give each grain its own")
        sizes = sorted({g.volume.voxel_size for g in self.grains})
        if sizes[-1] > sizes[0] * (1 + 1e-6):
            raise InputError("grains", f"voxel sizes {sizes[0]} and {sizes[-1]} mm", "cut all grains from one volume")

    def __len__(self) -> int:
        return len(self.grains)

    def without(self, rows: Collection[int]) -> GrainSet:
        """The same sample without the grains of some rows."""
        return replace(self, grains=tuple(g for k, g in enumerate(self.grains) if k not in rows))

    @property
    def labels(self) -> NDArray[np.int64]:
        """Labels ``(n,)``."""
        return np.array([g.label for g in self.grains], dtype=np.int64)

    @property
    def centers(self) -> NDArray[np.float64]:
        """Centres of mass ``(n, 3)``, mm, x y z."""
        return np.array([g.center for g in self.grains]).reshape(-1, 3)

    @property
    def precision(self) -> np.dtype[np.floating]:
        """The precision of the grains' voxels, and so of all work on them."""
        return np.result_type(*(g.volume.array.dtype for g in self.grains))

    @property
    def voxel_size(self) -> float:
        """Edge of a voxel, mm."""
        return self.grains[0].volume.voxel_size


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
        Who does that: as `partition.fine_grains`.

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
