"""Which labels are no grains but pistons, walls and wires: by size and shape against the grains' own.

A body is known by none of these alone: its attenuation may be that of the grains, one grain may be much larger than
the others, and a grain may be flat.  So a body is long against the grains *and* thin, or covers the sample's whole
cross-section, or is far larger than the grains and reaches the border of the volume.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from grainmotion.segmentation.blocks import Work
from grainmotion.segmentation.distance_basins import distances
from grainmotion.segmentation.label_measures import highest_label, label_boxes, label_sizes
from grainmotion.segmentation.label_pairs import LabelPairs

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
    def of(cls, labels: Ints, work: Work) -> Shapes:
        """Shapes of all labels but 0."""
        count = highest_label(labels, work)
        first, last = label_boxes(labels, count, work)
        numbers = np.flatnonzero(last[:, 0])
        low, high = first[numbers].astype(float), last[numbers].astype(float)
        volume = label_sizes(labels, count, work)[numbers].astype(float)
        at_border = ((low == 0) | (high == labels.shape)).any(axis=1)
        shapes = cls(numbers, volume, low, high, np.ones(len(numbers)), at_border)
        long = shapes.diagonal > LONG * typical_of_others(shapes.diagonal, volume)
        for k in np.flatnonzero(long) if len(numbers) > MIN_GRAINS_BESIDE else ():
            box = tuple(slice(a, b) for a, b in zip(first[numbers[k]], last[numbers[k]], strict=True))
            own = np.pad(labels[box] == numbers[k], 1)
            shapes.slender[k] = distances(own, work).max() / np.cbrt(3 * volume[k] / (4 * np.pi))
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


def typical_of_others(values: NDArray[np.float64], volumes: NDArray[np.float64]) -> NDArray[np.float64]:
    """Of each value `typical` of all others; NaN of a single one."""
    if len(values) < 2:
        return np.full(len(values), np.nan)
    order = np.argsort(values)
    own = np.sqrt(volumes[order])
    weights, place = np.cumsum(own), np.arange(len(own))
    half = (weights[-1] - own) / 2
    before = np.searchsorted(weights, half)  # if it comes before the value that is left out
    after = np.maximum(np.searchsorted(weights, half + own), place + 1)
    found = np.empty(len(values))
    found[order] = values[order][np.minimum(np.where(before < place, before, after), len(own) - 1)]
    return found


def large_bodies(labels: Ints, work: Work | None = None) -> tuple[int, ...]:
    """Labels that are no grains.

    Parameters
    ----------
    labels : (nz, ny, nx) int array
        0 for none.
    work : Work, optional
        Threads.

    Returns
    -------
    tuple of int
        Empty if there are too few labels to compare.
    """
    work = work or Work()
    shapes = Shapes.of(labels, work)
    found = np.zeros(len(shapes.volume), bool)
    for _ in range(len(found)):  # without those found the grains' own size is clearer
        more = _unlike(shapes, np.flatnonzero(~found))
        if not len(more) or np.count_nonzero(~found) - len(more) < MIN_GRAINS_BESIDE:
            break
        found[more] = True
    if not found.any():
        return ()
    grain = typical(shapes.volume[~found], shapes.volume[~found])
    return tuple(sorted(_with_fragments(labels, {int(k) for k in shapes.numbers[found]}, grain, work)))


def _with_fragments(labels: Ints, bodies: set[int], grain: float, work: Work) -> set[int]:
    """Bodies, and small labels with a broad contact to one, which were separated from it."""
    count = highest_label(labels, work)
    small = label_sizes(labels, count, work) < FRAGMENT * grain
    small[[0, *bodies]] = False
    body = np.isin(np.arange(count + 1), list(bodies))
    if not small.any():
        return bodies
    touching = LabelPairs.of(labels, labels, count, work)
    label, other = np.concatenate([touching.pairs, touching.pairs[:, ::-1]]).T
    faces = np.tile(touching.faces.sum(axis=1), 2)
    while small.any():
        contact = np.bincount(label, np.where(body[other], faces, 0), minlength=count + 1)
        more = small & (contact > FRAGMENT_CONTACT * np.maximum(touching.surface, 1))
        if not more.any():
            break
        body |= more
        small &= ~more
    return {int(k) for k in np.flatnonzero(body)}


def _unlike(shapes: Shapes, rest: NDArray[np.int64]) -> NDArray[np.int64]:
    """Those of some shapes that are unlike the others of these."""
    if len(rest) - 1 < MIN_GRAINS_BESIDE:
        return rest[:0]
    volumes, diagonal = shapes.volume[rest], shapes.diagonal[rest]
    unlike = (volumes > FAR_LARGER * typical_of_others(volumes, volumes)) & shapes.at_border[rest]
    long = ~unlike & (diagonal > LONG * typical_of_others(diagonal, volumes))
    for k in np.flatnonzero(long).tolist():
        own, others = rest[k], np.delete(rest, k)
        low, high = shapes.low[others].min(axis=0), shapes.high[others].max(axis=0)
        wide = np.clip((shapes.high[own] - shapes.low[own]) / (high - low), 0, 1)  # of the sample of grains
        covered = max(float(np.prod(np.delete(wide, axis))) for axis in range(3))
        covers = covered > COVERS and (shapes.slender[own] < NOT_COMPACT or shapes.at_border[own])
        unlike[k] = shapes.slender[own] < THIN or covers
    return rest[unlike]
