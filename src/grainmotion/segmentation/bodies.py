"""Bodies beside the grains: what no label holds, taken apart into connected pieces.

A piece is what is connected at half of its own attenuation.  Pieces that touch are two bodies if they are of clearly
different attenuation, as a steel piston in a glass tube is.  What is too small for a body is left to the rest.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from edt import edt
from numpy.typing import NDArray
from scipy import ndimage
from skimage.filters import threshold_otsu
from skimage.segmentation import expand_labels, watershed

from grainmotion.model.scene import Kind
from grainmotion.model.volume import Volume
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
MIN_PLACE_SHARE = 0.8
"""Share of a body's attenuation that must be above, below, or in a ring around the grains for the name of the place."""
SECTORS, MIN_SECTORS = 36, 0.75
"""Directions around the grains, and the share of them in which a wall must be."""

GRAIN_TAIL_VOXELS, GRAIN_TAIL_LEVEL = 1.5, 0.75
"""Voxels beyond a grain's label that are the grain's own surface, where the attenuation is below this share of the
grains'."""

Mask = NDArray[np.bool_]


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
    labels = labels.copy()
    first = int(labels.max(initial=0)) + 1
    cores, told = np.zeros(labels.shape, np.int32), dict[int, BodySettings]()
    for body in given:
        if body.label is not None and (labels == body.label).any():
            told[len(told) + 1] = body
            cores[labels == body.label] = len(told)
            labels[labels == body.label] = 0
    level = float(volume.array[labels > 0].mean()) if labels.any() else float(volume.array.max())
    for core in _cores(volume.array, beyond & (cores == 0), level):
        cores[core & (cores == 0)] = cores.max() + 1
    grains = labels > 0
    out, pieces = labels.astype(np.int32), list[Piece]()
    for k, box in enumerate(ndimage.find_objects(cores), start=1):
        if box is None:
            continue
        around = tuple(slice(max(s.start - SURFACE_VOXELS, 0), s.stop + SURFACE_VOXELS) for s in box)
        own, array = cores[around] == k, volume.array[around]
        half = float(np.median(array[own])) / 2
        near = ndimage.distance_transform_edt(~own) <= SURFACE_VOXELS
        mask = own
        if k not in told:
            mask = near & (array > half) & (out[around] == 0) & np.isin(cores[around], (0, k))
            if half < GRAIN_TAIL_LEVEL * level:  # what is as faint as a grain's surface is the grain's
                mask &= ndimage.distance_transform_edt(out[around] == 0) > GRAIN_TAIL_VOXELS
            mask |= own
        parts, _ = ndimage.label(mask)
        mask = mask & np.isin(parts, np.unique(parts[own & mask]))
        if k not in told:
            mask |= _surface_in_grains(array, out[around], mask, level)
        out[around][mask] = first + k - 1
        place = _place(out == first + k - 1, grains)
        name = told[k].name if k in told else _name(place, [p.name for p in pieces])
        kinds: dict[Place, Kind] = {"above": "piston", "below": "piston", "around": "wall", "beside": "body"}
        pieces.append(Piece(first + k - 1, name, kinds[place], place))
    return out, tuple(pieces)


def _surface_in_grains(array: NDArray[np.floating], labels: NDArray[np.integer], body: Mask, level: float) -> Mask:
    """Voxels of grains' labels that are the surface of a denser body: half of it is as dense as a grain.

    A watershed from the insides of the grains and from the body; the valley between them is the border.
    """
    grains = labels > 0
    if not grains.any() or float(np.percentile(array[body], BODY_LEVEL_PERCENTILE)) < MIN_MATERIAL_RATIO * level:
        return np.zeros(body.shape, bool)
    near = grains & (ndimage.distance_transform_edt(~body) <= CONTACT_VOXELS)
    markers = np.where(grains & (edt(labels.astype(np.uint32), black_border=False) > 1), 1, 0)
    markers[body] = 2
    return grains & (watershed(-array, markers, mask=near | body) == 2)


def _cores(array: NDArray[np.floating], beyond: Mask, level: float) -> list[Mask]:
    """The insides of all bodies, the largest first."""
    weight = ndimage.gaussian_filter(beyond.astype(np.float32), CORE_SIGMA)
    smooth = ndimage.gaussian_filter(np.where(beyond, array, 0), CORE_SIGMA) / np.maximum(weight, 1e-3)
    both = beyond[:, :, 1:] & beyond[:, :, :-1]
    if not both.any():
        return []
    noise = 1.4826 / np.sqrt(2) * float(np.median(np.abs(np.diff(array, axis=2)[both])))
    dense = beyond & (smooth > max(MIN_BODY_LEVEL * level, BODY_NOISE * noise))
    least = MIN_PIECE_SHARE * float(array.sum(dtype=float))
    out = []
    for piece in _pieces(dense, array, least):
        out += _materials(piece, smooth, array, least)
    return sorted(out, key=lambda core: -float(array[core].sum(dtype=float)))


def _pieces(mask: Mask, array: NDArray[np.floating], least: float) -> list[Mask]:
    """Connected pieces of a mask that hold attenuation of at least ``least``."""
    parts, count = ndimage.label(mask)
    masses = ndimage.sum_labels(array, parts, np.arange(1, count + 1)) if count else np.zeros(0)
    return [parts == k + 1 for k in np.nonzero(masses > least)[0]]


def _materials(piece: Mask, smooth: NDArray[np.floating], array: NDArray[np.floating], least: float) -> list[Mask]:
    """A piece, or its parts of two clearly different attenuations."""
    inside = ndimage.binary_erosion(piece, iterations=2)
    values = smooth[inside]
    if values.size < 2 or np.ptp(values) == 0:
        return [piece]
    limit = float(threshold_otsu(values))
    low, high = values[values <= limit], values[values > limit]
    if not (len(low) and len(high)) or high.mean() < MIN_MATERIAL_RATIO * low.mean():
        return [piece]
    between = len(low) * len(high) / len(values) ** 2 * (high.mean() - low.mean()) ** 2
    if between < MIN_SEPARABILITY * values.var():
        return [piece]
    dense = _pieces(inside & (smooth > limit), array, least / 2)
    shell = ndimage.binary_dilation(np.any([smooth <= -np.inf, *dense], axis=0), iterations=SURFACE_VOXELS)
    parts = [*dense, *_pieces(piece & ~shell, array, least / 2)]  # the surface of the denser one is none of the other
    if len(parts) < 2:
        return [piece]
    labels = np.zeros(piece.shape, np.int32)
    for k, part in enumerate(parts, start=1):
        labels[part] = k
    labels = np.where(piece, expand_labels(labels, distance=2 * SURFACE_VOXELS), 0)
    return [labels == k for k in range(1, len(parts) + 1)]


def _place(body: Mask, grains: Mask) -> Place:
    """Where a body is: above all grains, below them, around them, or beside."""
    z, y, x = np.nonzero(body)
    gz, gy, gx = np.nonzero(grains)
    if not len(gz) or not len(z):
        return "beside"
    low, high = np.percentile(gz, [2, 98])
    for place, share in (("above", (z > high).mean()), ("below", (z < low).mean())):
        if share > MIN_PLACE_SHARE:
            return "above" if place == "above" else "below"
    cy, cx = gy.mean(), gx.mean()
    far = np.percentile(np.hypot(gy - cy, gx - cx), 80)
    ring = np.hypot(y - cy, x - cx) > far
    angles = np.arctan2(y - cy, x - cx)[ring & (z >= low) & (z <= high)]
    filled = np.unique(np.floor((angles / (2 * np.pi) + 0.5) * SECTORS)).size / SECTORS
    return "around" if ring.mean() > 1 - MIN_PLACE_SHARE and filled >= MIN_SECTORS else "beside"


def _name(place: Place, taken: list[str]) -> str:
    """A name by place, with a number if it is taken."""
    base = {"above": "upper piston", "below": "lower piston", "around": "wall", "beside": "body"}[place]
    names = [base if base != "body" else "body 1", *(f"{base} {k}" for k in range(2, len(taken) + 3))]
    return next(name for name in names if name not in taken)
