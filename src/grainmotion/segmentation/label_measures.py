"""Sizes, means and boxes of labels, and labels replaced, by all threads; the same whatever the blocks."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from grainmotion.kernels.label_faces import add_faces_on_codes
from grainmotion.kernels.label_tables import (
    add_boxes,
    add_sizes,
    add_values,
    bring_back,
    replace_in_mask,
    replace_labels,
    set_aside,
)
from grainmotion.model.large_arrays import large_empty
from grainmotion.model.progress import counted
from grainmotion.segmentation.blocks import Work, chunks_of, slabs_of

Ints = NDArray[np.int32]
Counts = NDArray[np.int64]
AnyBox = tuple[slice, ...]

_STEPS_OF_SUMS = float(1 << 24)
"""Steps of the highest value in which values are added up."""


def highest_label(labels: NDArray[np.integer], work: Work) -> int:
    """The highest label."""
    flat = labels.reshape(-1)
    return max((int(flat[part].max()) for part in chunks_of(flat.size)), default=0)


def label_sizes(labels: NDArray[np.integer], count: int, work: Work) -> Counts:
    """Voxels ``(count + 1,)`` of each label."""
    flat = labels.reshape(-1)

    def add(part: slice, sizes: Counts) -> Counts:
        add_sizes(flat[part], sizes)
        return sizes

    return np.asarray(sum(work.gathered(chunks_of(flat.size), lambda: np.zeros(count + 1, np.int64), add)))


def label_sums(labels: NDArray[np.integer], values: NDArray, count: int, work: Work) -> NDArray[np.float64]:
    """Sums ``(count + 1,)`` of the values of each label, 0 for label 0."""
    flat, height = labels.reshape(-1), values.reshape(-1)
    unit = max(float(values.max()), -float(values.min()), 1e-30) / _STEPS_OF_SUMS

    def add(part: slice, sums: Counts) -> Counts:
        add_values(flat[part], height[part], unit, sums)
        return sums

    parts = work.gathered(chunks_of(flat.size), lambda: np.zeros(count + 1, np.int64), add)
    return np.asarray(np.asarray(sum(parts)) * unit, float)


def label_boxes(labels: NDArray[np.integer], count: int, work: Work) -> tuple[Counts, Counts]:
    """First and last (excluded) voxel ``(count + 1, 3)`` of each label; the last is 0 of none."""

    def start() -> tuple[Counts, Counts]:
        return np.full((count + 1, 3), np.iinfo(np.int64).max), np.zeros((count + 1, 3), np.int64)

    def add(slab: tuple[int, int], found: tuple[Counts, Counts]) -> tuple[Counts, Counts]:
        add_boxes(labels[slab[0] : slab[1]], slab[0], *found)
        return found

    parts = work.gathered(slabs_of(labels.shape), start, add)
    return np.minimum.reduce([low for low, _ in parts]), np.maximum.reduce([high for _, high in parts])


def boxes_of_labels(labels: NDArray[np.integer]) -> list[AnyBox | None]:
    """As `scipy.ndimage.find_objects`, slab by slab, with progress: the bounding box of each label from 1 on, None of
    numbers that no voxel has.
    """
    boxes = list[AnyBox | None]()
    for first, last in counted(slabs_of(labels.shape)):
        found = ndimage.find_objects(labels[first:last])
        boxes += [None] * (len(found) - len(boxes))
        for k, box in enumerate(found):
            if box is not None:
                own, before = (slice(box[0].start + first, box[0].stop + first), *box[1:]), boxes[k]
                boxes[k] = own if before is None else _around(before, own)
    return boxes


def _around(box: AnyBox, other: AnyBox) -> AnyBox:
    """The box that holds two."""
    return tuple(slice(min(a.start, b.start), max(a.stop, b.stop)) for a, b in zip(box, other, strict=True))


def faces_on_codes(labels: Ints, codes: NDArray[np.int8], count: int, work: Work) -> Counts:
    """Faces ``(count + 1, codes)`` of each label with voxels of other numbers, by the codes of these."""
    width = int(codes.max(initial=0)) + 1

    def add(slab: tuple[int, int], faces: Counts) -> Counts:
        add_faces_on_codes(labels, codes, *slab, faces)
        return faces

    parts = work.gathered(slabs_of(labels.shape), lambda: np.zeros((count + 1, width), np.int64), add)
    return np.asarray(sum(parts))


def renumber(labels: Ints, new: NDArray[np.integer], work: Work, mask: NDArray[np.bool_] | None = None) -> None:
    """Replace each label by a new one ``(n + 1,)`` in place; in a mask -1 where that is 0, outside of it 0."""
    flat, numbers = labels.reshape(-1), new.astype(np.int32)
    if mask is None:
        work.each(chunks_of(flat.size), lambda part: replace_labels(flat[part], numbers))
    else:
        wanted = mask.reshape(-1)
        work.each(chunks_of(flat.size), lambda part: replace_in_mask(flat[part], wanted[part], numbers))


def put_aside(labels: Ints, before: int, work: Work) -> None:
    """Set labels aside, in place, numbered after so many others, while others are found in the same array."""
    flat = labels.reshape(-1)
    work.each(chunks_of(flat.size), lambda part: set_aside(flat[part], before))


def take_back(labels: Ints, work: Work) -> None:
    """Make labels that are set aside labels again, in place."""
    flat = labels.reshape(-1)
    work.each(chunks_of(flat.size), lambda part: bring_back(flat[part]))


def looked_up(table: NDArray, labels: Ints, work: Work) -> NDArray:
    """The entry of a table for each label."""
    out = large_empty(labels.shape, table.dtype)
    flat, found = labels.reshape(-1), out.reshape(-1)
    work.each(chunks_of(flat.size), lambda part: np.take(table, flat[part], out=found[part], mode="clip"))
    return out


def kept_numbers(kept: NDArray[np.bool_]) -> Ints:
    """New numbers ``(n + 1,)`` 1, 2, … of the labels that are kept, 0 for the others; label 0 is not kept."""
    kept = kept.copy()
    kept[0] = False
    return np.where(kept, np.cumsum(kept), 0).astype(np.int32)
