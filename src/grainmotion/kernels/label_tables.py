"""Numbers of labels: sizes, sums, boxes; labels replaced in place.  All of whole numbers, so that order is nothing.

Labels may be negative: -1 where one is wanted, below it those that are set aside while others are found.
"""

from __future__ import annotations

import numba as nb
import numpy as np

from grainmotion.kernels.compilation import CACHE


@nb.njit(cache=CACHE, nogil=True)
def add_sizes(labels: np.ndarray, sizes: np.ndarray) -> None:
    """Add the number of voxels of each label of flat ``labels``, but of negative ones."""
    for i in range(len(labels)):
        if labels[i] >= 0:
            sizes[labels[i]] += 1


@nb.njit(cache=CACHE, nogil=True)
def add_values(labels: np.ndarray, values: np.ndarray, unit: float, sums: np.ndarray) -> None:
    """Add the values of each label, in whole numbers of a unit."""
    for i in range(len(labels)):
        if labels[i] > 0:
            sums[labels[i]] += np.int64(np.rint(values[i] / unit))


@nb.njit(cache=CACHE, nogil=True)
def add_boxes(labels: np.ndarray, plane: int, low: np.ndarray, high: np.ndarray) -> None:
    """Widen the boxes ``low``, ``high (n, 3)`` of the labels of some planes, the first of which has this number."""
    nz, ny, nx = labels.shape
    for z in range(nz):
        for y in range(ny):
            row, before = labels[z, y], 0
            for x in range(nx):
                label = row[x]
                if label > 0:
                    high[label, 2] = max(high[label, 2], x + 1)
                    if label != before:
                        low[label, 0], high[label, 0] = (
                            min(low[label, 0], plane + z),
                            max(high[label, 0], plane + z + 1),
                        )
                        low[label, 1], high[label, 1] = min(low[label, 1], y), max(high[label, 1], y + 1)
                        low[label, 2] = min(low[label, 2], x)
                before = label


@nb.njit(cache=CACHE, nogil=True)
def replace_labels(labels: np.ndarray, new: np.ndarray) -> None:
    """Replace each label of flat ``labels`` in place; -1 becomes 0, what is set aside stays."""
    for i in range(len(labels)):
        if labels[i] >= -1:
            labels[i] = new[labels[i]] if labels[i] > 0 else 0


@nb.njit(cache=CACHE, nogil=True)
def replace_in_mask(labels: np.ndarray, mask: np.ndarray, new: np.ndarray) -> None:
    """Replace each label in place; -1 where it becomes 0 within a mask, 0 outside of it; what is set aside stays."""
    for i in range(len(labels)):
        if labels[i] < -1 and not mask[i]:
            continue
        label = new[labels[i]] if labels[i] > 0 else 0
        labels[i] = (label if label > 0 else -1) if mask[i] else 0


@nb.njit(cache=CACHE, nogil=True)
def set_aside(labels: np.ndarray, before: int) -> None:
    """Set the labels of flat ``labels`` aside, numbered after so many others, as negative ones; those are kept."""
    for i in range(len(labels)):
        if labels[i] > 0:
            labels[i] = -1 - before - labels[i]


@nb.njit(cache=CACHE, nogil=True)
def bring_back(labels: np.ndarray) -> None:
    """Make labels that are set aside labels again."""
    for i in range(len(labels)):
        if labels[i] < -1:
            labels[i] = -1 - labels[i]
