"""Labels made by other software: what can be used of them, and specks that are no grains."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from grainmotion.errors import InputError
from grainmotion.model.label_sums import label_sizes
from grainmotion.model.large_arrays import large_copy
from grainmotion.segmentation.label_measures import boxes_of_labels

MIN_LABEL_VOXELS = 8
"""Voxels of the smallest label that is a grain: fewer have no orientation, and as a rule are specks of a threshold."""
MIN_LABEL_PIXELS = 4
"""The same in a slice one voxel thick."""
MAX_LABEL = 10_000_000
"""Largest number of a label: tables of all numbers up to it must fit in memory."""
MAX_SPECK_SHARE = 0.02
"""A piece of a label up to this share of the largest piece is a speck, no part of the grain."""


@dataclass(frozen=True, eq=False)
class CleanLabels:
    """Labels without specks, and what was dropped.

    Attributes
    ----------
    labels : (nz, ny, nx) int array
        The same labels; 0 where a speck was.
    dropped : tuple of int
        Labels of fewer than `MIN_LABEL_VOXELS` voxels, which are no grains.
    specks : dict of int to int
        Of each label that had small pieces apart from its largest, the voxels dropped.
    pieces : dict of int to tuple of int
        Of each label with several large pieces, their numbers of voxels, the largest first.
    """

    labels: NDArray[np.integer]
    dropped: tuple[int, ...]
    specks: dict[int, int]
    pieces: dict[int, tuple[int, ...]]

    @classmethod
    def of(cls, labels: NDArray[np.integer]) -> CleanLabels:
        """Drop the specks of checked labels.

        Parameters
        ----------
        labels : (nz, ny, nx) int array
            0 for no grain, 1, 2, ... for grains.

        Returns
        -------
        CleanLabels
            Whose labels are the same array if there was nothing to drop.
        """
        labels, dropped = without_small_labels(labels)
        specks, large = dict[int, int](), dict[int, tuple[int, ...]]()
        clean = labels
        for label, box in enumerate(boxes_of_labels(labels), start=1):
            if box is None:
                continue
            pieces, count = ndimage.label(labels[box] == label, np.ones((3, 3, 3)))
            if count < 2:
                continue
            sizes = np.bincount(pieces.ravel())
            sizes[0] = 0
            small = sizes <= max(MAX_SPECK_SHARE * sizes.max(), min(_fewest(labels), sizes.max() - 1))
            small[0] = False
            if small.any():
                clean = large_copy(labels) if clean is labels else clean
                clean[box][small[pieces]] = 0
                specks[label] = int(sizes[small].sum())
            if np.count_nonzero(sizes[~small]) > 1:
                large[label] = tuple(int(s) for s in sorted(sizes[~small & (sizes > 0)], reverse=True))
        return cls(clean, dropped, specks, large)


def checked_labels(labels: NDArray, shape: tuple[int, int, int] | None = None) -> NDArray[np.integer]:
    """Labels as they must be; an `InputError` says what they are instead."""
    labels = np.asarray(labels)
    if labels.dtype == bool:
        remedy = "give a number to each grain, as skimage.measure.label does, or use segment"
        raise InputError("labels", "they are a mask (bool), which doesn't tell grains apart", remedy)
    if not np.issubdtype(labels.dtype, np.integer):
        whole = np.issubdtype(labels.dtype, np.floating) and bool((labels == np.round(labels)).all())
        remedy = "give integers: labels.astype(int)" if whole else "give integers, 0 for no grain"
        raise InputError("labels", f"they are {labels.dtype}", remedy)
    if shape is not None and labels.shape != shape:
        raise InputError("labels", f"shape {labels.shape} is not the volume's {shape}", "give them on one grid")
    if labels.ndim != 3 or labels.size == 0:
        raise InputError("labels", f"shape {labels.shape} is not (z, y, x)", "give a 3-D stack")
    if labels.min() < 0 or labels.max() > MAX_LABEL:
        remedy = f"number the grains from 1 on, at most {MAX_LABEL}: skimage.segmentation.relabel_sequential(labels)[0]"
        raise InputError("labels", f"they run from {labels.min()} to {labels.max()}", remedy)
    return labels


def without_small_labels(labels: NDArray[np.integer]) -> tuple[NDArray[np.integer], tuple[int, ...]]:
    """Labels with those of too few voxels set to 0, and which they were."""
    sizes = label_sizes(labels)
    sizes[0] = 0
    small = (sizes > 0) & (sizes < _fewest(labels))
    dropped = tuple(int(label) for label in np.flatnonzero(small))
    if not dropped:
        return labels, ()
    kept = large_copy(labels)
    for plane in kept:
        plane[small[plane]] = 0
    return kept, dropped


def _fewest(labels: NDArray[np.integer]) -> int:
    return MIN_LABEL_VOXELS if min(labels.shape) > 1 else MIN_LABEL_PIXELS
