"""Which labels are no grains but pistons, walls and wires: by size and shape against the grains' own.

A body is known by none of these alone: its attenuation may be that of the grains, one grain may be much larger than
the others, and a grain may be flat.  So a body is long against the grains *and* thin, or covers the sample's whole
cross-section, or is far larger than the grains and reaches the border of the volume.
"""

from __future__ import annotations

from dataclasses import dataclass

import edt
import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

Ints = NDArray[np.integer]

MIN_GRAINS_BESIDE = 2
"""Labels beside a body, by which it is judged."""
LONG = 1.6
"""Diagonal of a body's bounding box over that of a typical grain; stones of 10 to 32 voxels together reach 1.6."""
THIN = 0.33
"""Radius of the largest ball in a sheet, tube or wire over that of the ball of its volume; stones have 0.4 to 0.8."""
NOT_COMPACT = 0.6
"""The same in a body that covers the cross-section of the sample."""
COVERS = 0.7
"""Share of the sample's cross-section, along any axis, that a piston or wall covers."""
FAR_LARGER = 30.0
"""Volume of a body at the volume's border over the median grain's."""

FRAGMENT = 0.15
"""Volume of a fragment of a body over that of a typical grain, at most."""
FRAGMENT_CONTACT = 0.1
"""Share of a fragment's surface that lies on its body; a grain touches one with a few percent."""


@dataclass(frozen=True, eq=False)
class Shapes:
    """Size and shape of labels, in voxels; all arrays ``(n,)`` or, ``low`` and ``high`` of bounding boxes, ``(n, 3)``.

    ``slender`` is the radius of the largest ball inside over that of the ball of the same volume, 1 where a label is
    not long against the others; ``at_border`` whether it reaches a face of the volume.
    """

    numbers: NDArray[np.int64]
    volume: NDArray[np.float64]
    low: NDArray[np.float64]
    high: NDArray[np.float64]
    slender: NDArray[np.float64]
    at_border: NDArray[np.bool_]

    @classmethod
    def of(cls, labels: Ints) -> Shapes:
        """Shapes of all labels but 0."""
        boxes = ndimage.find_objects(labels)
        numbers = np.array([k for k, box in enumerate(boxes, start=1) if box is not None], np.int64)
        low, high = (
            np.array([[getattr(s, end) for s in boxes[k - 1]] for k in numbers], float).reshape(-1, 3)
            for end in ("start", "stop")
        )
        volume = np.bincount(labels.ravel())[numbers].astype(float)
        at_border = ((low == 0) | (high == labels.shape)).any(axis=1)
        shapes = cls(numbers, volume, low, high, np.ones(len(numbers)), at_border)
        for k in range(len(numbers)) if len(numbers) > MIN_GRAINS_BESIDE else ():
            others = np.arange(len(numbers)) != k
            if shapes.diagonal[k] > LONG * typical(shapes.diagonal[others], volume[others]):
                own = np.pad(labels[boxes[numbers[k] - 1]] == numbers[k], 1)
                shapes.slender[k] = edt.edt(own, parallel=1).max() / np.cbrt(3 * volume[k] / (4 * np.pi))
        return shapes

    @property
    def diagonal(self) -> NDArray[np.float64]:
        """Diagonals of the bounding boxes, voxels."""
        return np.asarray(np.linalg.norm(self.high - self.low, axis=1))


def typical(values: NDArray[np.float64], volumes: NDArray[np.float64]) -> float:
    """Median weighted by the roots of the volumes: neither many fragments nor one wall move it."""
    order = np.argsort(values)
    weights = np.cumsum(np.sqrt(volumes[order]))
    return float(values[order][np.searchsorted(weights, weights[-1] / 2)])


def large_bodies(labels: Ints) -> tuple[int, ...]:
    """Labels that are no grains.

    Parameters
    ----------
    labels : (nz, ny, nx) int array
        0 for none.

    Returns
    -------
    tuple of int
        Empty if there are too few labels to compare.
    """
    shapes = Shapes.of(labels)
    found = np.zeros(len(shapes.volume), bool)
    for _ in range(len(found)):  # without those found the grains' own size is clearer
        more = [k for k in np.flatnonzero(~found).tolist() if _unlike(shapes, k, ~found & (np.arange(len(found)) != k))]
        if not more or np.count_nonzero(~found) - len(more) < MIN_GRAINS_BESIDE:
            break
        found[more] = True
    if not found.any():
        return ()
    grain = typical(shapes.volume[~found], shapes.volume[~found])
    return tuple(sorted(_with_fragments(labels, {int(k) for k in shapes.numbers[found]}, grain)))


def _with_fragments(labels: Ints, bodies: set[int], grain: float) -> set[int]:
    """Bodies, and small labels with a broad contact to one, which were separated from it."""
    sizes = np.bincount(labels.ravel())
    small = sizes < FRAGMENT * grain
    small[[0, *bodies]] = False
    body = np.isin(np.arange(len(sizes)), list(bodies))
    while small.any():
        contact, surface = np.zeros(len(sizes)), np.zeros(len(sizes))
        for axis in range(3):
            own = np.moveaxis(labels, axis, 0)
            for inner, outer in ((slice(None, -1), slice(1, None)), (slice(1, None), slice(None, -1))):
                faces = small[own[inner]] & (own[inner] != own[outer])
                label, other = own[inner][faces], own[outer][faces]
                surface += np.bincount(label, minlength=len(sizes))
                contact += np.bincount(label[body[other]], minlength=len(sizes))
        more = small & (contact > FRAGMENT_CONTACT * np.maximum(surface, 1))
        if not more.any():
            break
        body |= more
        small &= ~more
    return {int(k) for k in np.flatnonzero(body)}


def _unlike(shapes: Shapes, k: int, grains: NDArray[np.bool_]) -> bool:
    """Whether shape k is unlike those of the grains."""
    if np.count_nonzero(grains) < MIN_GRAINS_BESIDE:
        return False
    volumes = shapes.volume[grains]
    larger = shapes.volume[k] > FAR_LARGER * typical(volumes, volumes)
    if larger and shapes.at_border[k]:
        return True
    if shapes.diagonal[k] <= LONG * typical(shapes.diagonal[grains], volumes):
        return False
    low, high = shapes.low[grains].min(axis=0), shapes.high[grains].max(axis=0)
    wide = np.clip((shapes.high[k] - shapes.low[k]) / (high - low), 0, 1)  # of the sample of grains
    covered = max(float(np.prod(np.delete(wide, axis))) for axis in range(3))
    covers = covered > COVERS and (shapes.slender[k] < NOT_COMPACT or shapes.at_border[k])
    return bool(shapes.slender[k] < THIN or covers)
