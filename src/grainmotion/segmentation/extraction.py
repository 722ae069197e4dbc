"""Grains extracted from a labelled volume: each with its own voxels."""

from __future__ import annotations

import warnings
from collections.abc import Collection, Iterator
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from grainmotion._arguments import checked_arguments
from grainmotion.errors import InputError
from grainmotion.kernels.layout import PADDING
from grainmotion.model.grains import Grain, GrainSet
from grainmotion.model.label_sums import mean_of_labels
from grainmotion.model.progress import counted, detail
from grainmotion.model.scene import NO_MOTION, RIGID_MOTION, Body, Freedom, Scene
from grainmotion.model.slabs import slabs
from grainmotion.model.thread_map import THREADS_OF_SLABS, by_threads
from grainmotion.model.volume import Volume
from grainmotion.segmentation.bodies import Piece, find_bodies
from grainmotion.segmentation.fluid import find_fluid, without_fluid
from grainmotion.segmentation.grain_cutting import Boxed, Cut, CutSettings, cut_grains
from grainmotion.segmentation.label_growth import out_of_reach, owned_by
from grainmotion.segmentation.label_measures import boxes_of_labels
from grainmotion.segmentation.labels import checked_labels, without_small_labels
from grainmotion.segmentation.segment import Segmentation
from grainmotion.segmentation.settings import Background, SegmentSettings

MIN_BACKGROUND_SHARE = 0.02
"""Share of all attenuation from which the background is kept."""
MAX_REACH_WITH_REST = 1.5
"""Largest ``reach`` where there is attenuation that belongs to no grain and no body, or a liquid, voxels."""
BACKGROUND_SIGMA = 2.0
"""Width of the Gaussian filter under which a background is distinguished from noise, voxels."""
MAX_CUT_BYTES = 1 << 28
"""Memory of grains in single precision on their finest voxels from which they are kept compactly (decision 0063)."""
MAX_LABELS_NAMED = 10
"""Labels that a warning lists."""
PLANES_FILTERED_TOGETHER = 32
"""Planes of the volume that are filtered together, as a filtered copy of all may not fit into memory."""
BACKGROUND_LEVEL = 0.02
"""Level from which filtered attenuation is background, over the mean of the grains."""


@checked_arguments
def extract_grains(
    volume: Volume, segmentation: Segmentation, settings: SegmentSettings | None = None, *, cut: Cut = cut_grains
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
        Cuts the grains, as `grain_cutting.cut_grains`.

    Returns
    -------
    GrainSet
        One grain a label that holds attenuation.

    Raises
    ------
    InputError
        If the labels are not the volume's, or there is no grain.

    Examples
    --------
    >>> grains = gm.extract_grains(volume, gm.segment(volume))
    >>> len(grains)
    4
    """
    return _grains_and_scene(volume, segmentation.labels, segmentation.border, settings or SegmentSettings(), cut)


@checked_arguments
def grains_from_labels(
    volume: Volume,
    labels: NDArray[np.integer],
    *,
    reach: float = 3.0,
    border: Collection[int] = (),
    background: Background = "auto",
    finer: int = 2,
    cut: Cut = cut_grains,
) -> GrainSet:
    """Extract the grains of a labelled volume.

    All attenuation must belong to some body (Σ μ⁽ⁱ⁾ = μ): voxels without a label, such as partial-volume
    surfaces, belong to the nearest grain up to ``reach`` voxels away.  In a liquid, which becomes ``scene.fluid``,
    grains hold their excess over it; `extract_grains` can be told that there is none, or its attenuation.

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
        Attenuation further away: ignored, fixed in all states, or moving.  Connected pieces, such as pistons and
        walls, are bodies of their own (see `bodies.find_bodies`), what is left is one more.  "auto" is moving if it
        holds more than `MIN_BACKGROUND_SHARE` of all attenuation, else ignored.  What is left begins
        `MAX_REACH_WITH_REST` voxels from the labels, so that no grain carries a piece of it.
    finer : int
        Factor by which each grain is upsampled as well, with refined boundaries (see `label_refinement`); 1 is none.
        A slice one voxel thick is not upsampled.
    cut : callable, optional
        Cuts the grains, as `grain_cutting.cut_grains`.

    Returns
    -------
    GrainSet
        The grains, one for each label that holds attenuation, and the bodies beside them.  Labels of fewer
        than `labels.MIN_LABEL_VOXELS` voxels are dropped, with a warning.

    Raises
    ------
    InputError
        If shapes differ, labels are not integers from 0 on, or there is no grain.

    Examples
    --------
    >>> grains = gm.grains_from_labels(volume, labels)
    >>> grains.labels.tolist()
    [1, 2, 3, 4]
    """
    settings = SegmentSettings(reach=reach, background=background, finer=finer)
    return _grains_and_scene(volume, labels, border, settings, cut)


def _grains_and_scene(
    volume: Volume, labels: NDArray[np.integer], border: Collection[int], settings: SegmentSettings, cut: Cut
) -> GrainSet:
    """The grains of labels, and what no label holds."""
    detail("cutting grains", 0, 2)
    labels, small = without_small_labels(checked_labels(labels, volume.shape))
    if small:
        some = ", ".join(str(label) for label in small[:MAX_LABELS_NAMED])
        warnings.warn(f"{len(small)} labels of too few voxels are no grains: {some}", stacklevel=3)
    told = None if isinstance(settings.fluid, str) else settings.fluid
    fluid = None if settings.fluid == "none" else find_fluid(volume, labels, told)
    whole = volume
    if fluid is not None:
        volume = without_fluid(volume, fluid, labels)
        settings = replace(settings, reach=min(settings.reach, MAX_REACH_WITH_REST))
    owned = _owners(volume, labels, settings, whole)
    grains = _cut(volume, owned, settings, cut)
    if not grains:
        raise InputError("labels", "no grains found", "check the threshold, or the labels given")
    store_contiguously(grains)
    grains = [replace(grain, touches_border=True) if grain.label in border else grain for grain in grains]
    bodies = _bodies(volume, owned, settings)
    return GrainSet(tuple(grains), Scene(tuple(bodies), fluid, volume.field, volume.hardening))


@dataclass(frozen=True, eq=False)
class _Owners:
    """To what each voxel belongs: labels of grains and bodies, which reach so many voxels beyond them, and the rest."""

    labels: NDArray[np.integer]
    reach: float
    pieces: tuple[Piece, ...] = ()
    rest: bool = False


def _owners(volume: Volume, labels: NDArray[np.integer], settings: SegmentSettings, whole: Volume) -> _Owners:
    """Grains, bodies and the rest."""
    reach, background, pieces = settings.reach, settings.background, tuple[Piece, ...]()
    deep, told = min(volume.shape) > 1, any(body.label is not None for body in settings.bodies)
    if background == "ignore" and not told:
        return _Owners(labels, reach)
    beyond = out_of_reach(labels, reach)
    share = _unowned_share(volume, labels, beyond, whole) if background == "auto" and deep else 0.0
    if deep and (background != "auto" or share > MIN_BACKGROUND_SHARE or told):
        labels, pieces = find_bodies(volume, labels, beyond, settings.bodies)
        if background == "auto" and pieces:
            share = _unowned_share(volume, labels, out_of_reach(labels, reach), whole)
    rest = share > MIN_BACKGROUND_SHARE if background == "auto" else background != "ignore"
    return _Owners(labels, min(reach, MAX_REACH_WITH_REST) if rest else reach, pieces, rest)


def _cut(volume: Volume, owned: _Owners, settings: SegmentSettings, cut: Cut) -> list[Grain]:
    """The grains, without those that hold no attenuation."""
    end = owned.pieces[0].label if owned.pieces else int(owned.labels.max(initial=0)) + 1
    places = boxes_of_labels(owned.labels)[: end - 1]
    boxes = [(label, box) for label, box in enumerate(places, start=1) if box is not None]
    how = CutSettings(owned.reach, settings.finer if min(volume.shape) > 1 else 1)
    if volume.array.dtype == np.float32 and _cut_bytes(boxes, how) > MAX_CUT_BYTES:
        how = replace(how, compact=True)
    detail("cutting grains", 1, 2)
    return [grain for grain in counted(cut(volume, owned.labels, boxes, how), len(boxes)) if grain is not None]


def _bodies(volume: Volume, owned: _Owners, settings: SegmentSettings) -> Iterator[Body]:
    """The bodies with their attenuation, names and freedoms."""
    free = NO_MOTION if settings.background == "fixed" else RIGID_MOTION
    for piece in owned.pieces:
        told = next((b for b in settings.bodies if b.name == piece.name or b.place == piece.place), None)
        name, freedom = (piece.name, free) if told is None else (told.name, Freedom.of(told.freedom))
        yield Body(name, piece.kind, volume.cropped(owned_by(owned.labels, owned.reach, piece.label)), freedom)
    if owned.rest:
        yield Body("rest", "rest", volume.cropped(out_of_reach(owned.labels, owned.reach)), free)


def _unowned_share(volume: Volume, labels: NDArray[np.integer], beyond: NDArray[np.bool_], with_fluid: Volume) -> float:
    """Share of all attenuation, a liquid's included, that belongs to no label, to no liquid and is no noise."""
    whole = float(with_fluid.array.sum(dtype=float))
    grain = mean_of_labels(labels, with_fluid.array)
    if whole <= 0:
        return 0.0

    def unowned(slab: tuple[slice, slice]) -> float:
        around, inner = slab
        rest = np.where(beyond[around], volume.array[around], 0)
        rest = ndimage.gaussian_filter(rest, BACKGROUND_SIGMA)[inner]
        return float(rest[rest > BACKGROUND_LEVEL * grain].sum(dtype=float))

    margin = int(4 * BACKGROUND_SIGMA + 0.5)
    each = slabs(len(beyond), margin, PLANES_FILTERED_TOGETHER)
    return sum(by_threads(unowned, each, THREADS_OF_SLABS)) / whole


def _cut_bytes(boxes: list[Boxed], how: CutSettings) -> int:
    """Memory of all grains in single precision on their finest voxels, about."""
    edges = np.array([[s.stop - s.start for s in box] for _, box in boxes]).reshape(-1, 3) + 2 * int(how.reach)
    return int(4 * (how.upsampling * edges + 2 * PADDING).prod(axis=1).sum())


def store_contiguously(grains: list[Grain]) -> None:
    """Move the voxels of all grains, in place, to one array (and finer ones to another), as kernels need them.

    Compact ones stay where they are.
    """
    _move(grains, "volume")
    _move(grains, "fine")


def _move(grains: list[Grain], name: Literal["volume", "fine"]) -> None:
    volumes = [getattr(grain, name) for grain in grains]
    if not all(isinstance(volume, Volume) for volume in volumes):
        return
    whole = np.empty(sum(volume.array.size for volume in volumes), volumes[0].array.dtype)
    del volumes
    end = 0
    for k, grain in enumerate(grains):  # one by one, so that the memory of each is freed once it is copied
        volume = getattr(grain, name)
        start, end = end, end + volume.array.size
        place = whole[start:end].reshape(volume.shape)
        place[:] = volume.array
        grains[k] = replace(grain, **{name: replace(volume, array=place)})
