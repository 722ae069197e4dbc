"""Numbers of the labels of a volume, plane by plane: no copy of the whole volume is made."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from grainmotion._typing import Float, Index
from grainmotion.model.progress import counted


def label_sizes(labels: NDArray[np.integer], minlength: int = 0) -> Index:
    """Voxels of each label from 0 to the highest, ``(n,)``, and up to ``minlength``."""
    sizes = np.zeros(max(minlength, _highest(labels) + 1), np.int64)
    for plane in counted(labels):
        own = np.bincount(plane.ravel())
        sizes[: len(own)] += own
    return sizes


def label_sums(labels: NDArray[np.integer], values: NDArray[np.floating]) -> Float:
    """Sums of the values of each label from 0 to the highest, ``(n,)``."""
    sums = np.zeros(_highest(labels) + 1)
    for plane, of_plane in zip(counted(labels), values, strict=True):
        own = np.bincount(plane.ravel(), of_plane.ravel())
        sums[: len(own)] += own
    return sums


def mean_of_labels(labels: NDArray[np.integer], values: NDArray[np.floating]) -> float:
    """Mean of the values of all labels above 0 together; 0 if there are none."""
    sizes, sums = label_sizes(labels)[1:], label_sums(labels, values)[1:]
    return float(sums.sum() / sizes.sum()) if sizes.any() else 0.0


def _highest(labels: NDArray[np.integer]) -> int:
    """The highest label."""
    return max((int(plane.max(initial=0)) for plane in counted(labels)), default=0)
