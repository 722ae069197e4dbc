"""Bodies beside the grains: what no label holds, taken apart into connected pieces.

A piece is what is connected at half of its own attenuation.  Pieces that touch are two bodies if they are of clearly
different attenuation, as a steel piston in a glass tube is.  What is too small for a body is left to the rest.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from edt import edt
from numpy.typing import NDArray
from scipy import ndimage
from skimage.segmentation import expand_labels, watershed

from grainmotion._typing import Image
from grainmotion.model.label_sums import label_sums, mean_of_labels
from grainmotion.model.large_arrays import large_copy, large_empty
from grainmotion.model.quantiles import quantile_of_parts
from grainmotion.model.scene import Kind
from grainmotion.model.slabs import slabs
from grainmotion.model.volume import Volume
from grainmotion.preprocessing.volume_threshold import otsu
from grainmotion.segmentation.body_places import GrainsExtent
from grainmotion.segmentation.settings import BodySettings, Place

MIN_PIECE_SHARE = 0.01
"""Share of all attenuation from which a connected piece is a body of its own."""
MIN_BODY_LEVEL, BODY_NOISE = 0.05, 1.2
"""Filtered attenuation from which a voxel may be of a body: over the mean of the grains, and over the noise of a voxel,
of which the filter leaves a third or less."""
CORE_SIGMA = 1.0
"""Width of the Gaussian filter under which bodies are told from noise, voxels."""
SURFACE_VOXELS = 4
"""Distance from its core up to which a body's surface lies, voxels."""
BODY_LEVEL_PERCENTILE = 75
"""Percentile of a body's voxels that is its attenuation: half of a thin one may be its surface."""
CONTACT_VOXELS = 2
"""Distance up to which a grain's label may hold the surface of a denser body that it touches, voxels."""
MIN_MATERIAL_RATIO, MIN_SEPARABILITY = 1.5, 0.75
"""Two materials that touch are two bodies if their attenuations differ by this ratio, and if the difference between
them is this share of the variance of all."""
GRAIN_TAIL_VOXELS, GRAIN_TAIL_LEVEL = 1.5, 0.75
"""Voxels beyond a grain's label that are the grain's own surface, where the attenuation is below this share of the
grains'."""

PLANES_EXPANDED = 16
"""Planes in which parts of a body are grown together, which takes 44 bytes a voxel."""

Mask = NDArray[np.bool_]
Box = tuple[slice, ...]


@dataclass(frozen=True)
class Piece:
    """One body: its label in the volume of `find_bodies`, and what it is by its place."""

    label: int
    name: str
    kind: Kind
    place: Place


def find_bodies(
    volume: Volume, labels: NDArray[np.integer], beyond: Mask, given: Sequence[BodySettings] = ()
) -> tuple[NDArray[np.integer], tuple[Piece, ...]]:
    """Labels of bodies that follow those of the grains, and the bodies.

    Parameters
    ----------
    volume : Volume
        Attenuation, 1/mm.
    labels : (nz, ny, nx) int array
        Grains, 0 for none.
    beyond : (nz, ny, nx) bool array
        Voxels that are out of reach of the grains.
    given : sequence of BodySettings
        Those of them that name a label make that a body instead of a grain.

    Returns
    -------
    tuple
        The labels, of grains and bodies, and what the bodies are, in order of their labels.
    """
    out = large_copy(labels.astype(np.int32, copy=False))
    first = int(labels.max(initial=0)) + 1
    told, cores = dict[int, BodySettings](), list[Core]()
    for body in given:
        box = None if body.label is None else _box_of(labels, body.label)
        if box is not None:
            cores.append(Core(box, labels[box] == body.label))
            told[len(cores)] = body
            out[box][cores[-1].own] = 0
    extent = GrainsExtent.of(out)
    level = mean_of_labels(out, volume.array) if extent is not None else float(volume.array.max())
    for core in cores:
        beyond = beyond & ~core.filled(beyond.shape)
    cores += _cores(volume.array, beyond, level)
    numbers = np.zeros(labels.shape, np.min_scalar_type(len(cores)))
    for k, core in enumerate(cores, start=1):
        numbers[core.box][core.own & (numbers[core.box] == 0)] = k
    pieces = list[Piece]()
    kinds: dict[Place, Kind] = {"above": "piston", "below": "piston", "around": "wall", "beside": "body"}
    for k, core in enumerate(cores, start=1):
        around = tuple(slice(max(s.start - SURFACE_VOXELS, 0), s.stop + SURFACE_VOXELS) for s in core.box)
        own, array, owner = numbers[around] == k, volume.array[around], out[around]
        mask = own
        if k not in told:
            mask = _with_surface(own, array, owner, numbers[around], level)
            mask |= _surface_in_grains(array, owner, mask, level)
        owner[mask] = first + k - 1
        place = "beside" if extent is None else extent.place(tuple(s.start for s in around), mask)
        name = told[k].name if k in told else _name(place, [p.name for p in pieces])
        pieces.append(Piece(first + k - 1, name, kinds[place], place))
    return out, tuple(pieces)


@dataclass(frozen=True, eq=False)
class Core:
    """The inside of a body: its box in the volume, and which voxels of that are its own."""

    box: Box
    own: Mask

    def mass(self, array: Image) -> float:
        """Sum of its voxels."""
        return float(array[self.box].sum(dtype=float, where=self.own))

    def filled(self, shape: tuple[int, ...]) -> Mask:
        """Its voxels in the whole volume."""
        out = np.zeros(shape, bool)
        out[self.box] = self.own
        return out

    def inside(self, box: Box) -> Core:
        """The core, whose box was counted from the first voxel of another one, in the whole volume."""
        place = tuple(slice(s.start + o.start, s.stop + o.start) for s, o in zip(self.box, box, strict=True))
        return Core(place, self.own)


def _box_of(labels: NDArray[np.integer], label: int) -> Box | None:
    """The box that holds a label; None if no voxel has it."""
    boxes = ndimage.find_objects(labels, label)
    return boxes[label - 1] if len(boxes) >= label else None


def _with_surface(own: Mask, array: Image, owner: NDArray[np.integer], numbers: NDArray, level: float) -> Mask:
    """A core with what around it is more than half as dense and belongs to nothing else; all arrays cut to its box."""
    half = quantile_of_parts(lambda: (a[o] for a, o in zip(array, own, strict=True)), 0.5) / 2
    mask = np.empty_like(own)
    for around, inner in slabs(len(own), SURFACE_VOXELS + 1):
        here = slice(around.start + inner.start, around.start + inner.stop)
        near = edt(~own[around], parallel=1)[inner] <= SURFACE_VOXELS
        near &= (array[here] > half) & (owner[here] == 0) & ((numbers[here] == 0) | own[here])
        if half < GRAIN_TAIL_LEVEL * level:  # what is as faint as a grain's surface is the grain's
            near &= edt(owner[around] == 0, parallel=1)[inner] > GRAIN_TAIL_VOXELS
        mask[here] = near | own[here]
    parts, count = ndimage.label(mask)
    connected = np.zeros(count + 1, bool)
    connected[parts[own]] = True
    return np.asarray(connected[parts])


def _surface_in_grains(array: Image, labels: NDArray[np.integer], body: Mask, level: float) -> Mask:
    """Voxels of grains' labels that are the surface of a denser body: half of it is as dense as a grain.

    A watershed from the insides of the grains and from the body, contact by contact; the valley between them is the
    border.
    """
    out = np.zeros(body.shape, bool)
    dense = quantile_of_parts(lambda: (a[o] for a, o in zip(array, body, strict=True)), BODY_LEVEL_PERCENTILE / 100)
    if not labels.any() or dense < MIN_MATERIAL_RATIO * level:
        return out
    near = np.zeros(body.shape, bool)
    for around, inner in slabs(len(body), CONTACT_VOXELS + 1):
        here = slice(around.start + inner.start, around.start + inner.stop)
        near[here] = (labels[here] > 0) & (edt(~body[around], parallel=1)[inner] <= CONTACT_VOXELS)
    contacts, _ = ndimage.label(near)
    for k, place in enumerate(ndimage.find_objects(contacts), start=1):
        box = tuple(slice(max(s.start - CONTACT_VOXELS, 0), s.stop + CONTACT_VOXELS) for s in place)
        inside = edt(labels[box].astype(np.uint32), black_border=False) > 1
        markers = ((labels[box] > 0) & inside).astype(np.int32)
        markers[body[box]] = 2
        contact = contacts[box] == k
        out[box] |= contact & (watershed(-array[box], markers, mask=contact | body[box]) == 2)
    return out


def _cores(array: Image, beyond: Mask, level: float) -> list[Core]:
    """The insides of all bodies, the largest first."""

    def steps() -> Iterator[Image]:
        for plane, free in zip(array, beyond, strict=True):
            yield np.abs(np.diff(plane, axis=1)[free[:, 1:] & free[:, :-1]])

    noise = 1.4826 / np.sqrt(2) * quantile_of_parts(steps, 0.5)
    if np.isnan(noise):
        return []
    dense = np.empty(array.shape, bool)
    for here, smooth in _smoothed(array, beyond):
        dense[here] = beyond[here] & (smooth > max(MIN_BODY_LEVEL * level, BODY_NOISE * noise))
    least = MIN_PIECE_SHARE * float(array.sum(dtype=float))
    out = [core for piece in _pieces(dense, array, least) for core in _materials(piece, array, beyond, least)]
    return sorted(out, key=lambda core: -core.mass(array))


def _smoothed(array: Image, beyond: Mask) -> Iterator[tuple[slice, Image]]:
    """Planes of the volume under a Gaussian filter over voxels that are beyond the grains' reach."""
    for around, inner in slabs(len(array), int(4 * CORE_SIGMA + 0.5)):
        weight = ndimage.gaussian_filter(beyond[around].astype(np.float32), CORE_SIGMA)[inner]
        smooth = ndimage.gaussian_filter(np.where(beyond[around], array[around], 0), CORE_SIGMA)[inner]
        yield slice(around.start + inner.start, around.start + inner.stop), smooth / np.maximum(weight, 1e-3)


def _pieces(mask: Mask, array: Image, least: float) -> list[Core]:
    """Connected pieces of a mask that hold attenuation of at least ``least``."""
    parts, count = ndimage.label(mask)
    if not count:
        return []
    masses, boxes = label_sums(parts, array), ndimage.find_objects(parts)
    return [Core(boxes[k], parts[boxes[k]] == k + 1) for k in np.flatnonzero(masses[1:] > least)]


def _materials(piece: Core, array: Image, beyond: Mask, least: float) -> list[Core]:
    """A piece, or its parts of two clearly different attenuations."""
    own, smooth = piece.own, _smooth_in(piece.box, array, beyond)
    inside = ndimage.binary_erosion(own, iterations=2)
    values = smooth[inside]
    if values.size < 2 or np.ptp(values) == 0:
        return [piece]
    limit = otsu(values)
    dense = values > limit
    count = int(np.count_nonzero(dense))
    if not 0 < count < len(values):
        return [piece]
    low, high = (float(values.mean(dtype=float, where=chosen)) for chosen in (~dense, dense))
    between = count * (len(values) - count) / len(values) ** 2 * (high - low) ** 2
    if high < MIN_MATERIAL_RATIO * low or between < MIN_SEPARABILITY * float(values.var(dtype=float)):
        return [piece]
    parts = _pieces(inside & (smooth > limit), array[piece.box], least / 2)
    del smooth, values
    shell = np.zeros(own.shape, bool)
    for part in parts:
        shell[part.box] |= part.own
    shell = ndimage.binary_dilation(shell, iterations=SURFACE_VOXELS)
    parts += _pieces(own & ~shell, array[piece.box], least / 2)  # the surface of the denser one is none of the other
    if len(parts) < 2:
        return [piece]
    labels = np.zeros(own.shape, np.int32)
    for k, part in enumerate(parts, start=1):
        labels[part.box][part.own] = k
    grown, reach = np.zeros_like(labels), 2 * SURFACE_VOXELS
    for around, inner in slabs(len(own), reach + 1, PLANES_EXPANDED):
        here = slice(around.start + inner.start, around.start + inner.stop)
        grown[here] = np.where(own[here], expand_labels(labels[around], distance=reach)[inner], 0)
    boxes = ndimage.find_objects(grown)
    return [Core(box, grown[box] == k).inside(piece.box) for k, box in enumerate(boxes, start=1)]


def _smooth_in(box: Box, array: Image, beyond: Mask) -> Image:
    """The filtered volume in a box."""
    margin = int(4 * CORE_SIGMA + 0.5)
    wide = tuple(slice(max(s.start - margin, 0), s.stop + margin) for s in box)
    out = large_empty(array[box].shape, array.dtype)
    z, *inner = (slice(s.start - w.start, s.stop - w.start) for s, w in zip(box, wide, strict=True))
    for here, smooth in _smoothed(array[wide], beyond[wide]):
        low, high = max(here.start, z.start), min(here.stop, z.stop)
        if low < high:
            out[low - z.start : high - z.start] = smooth[low - here.start : high - here.start, *inner]
    return out


def _name(place: Place, taken: list[str]) -> str:
    """A name by place, with a number if it is taken."""
    base = {"above": "upper piston", "below": "lower piston", "around": "wall", "beside": "body"}[place]
    names = [base if base != "body" else "body 1", *(f"{base} {k}" for k in range(2, len(taken) + 3))]
    return next(name for name in names if name not in taken)
