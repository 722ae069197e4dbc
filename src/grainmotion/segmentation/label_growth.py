"""Labels grown into the partial volumes around them, a few planes at a time."""

from __future__ import annotations

import itertools

import numpy as np
from numpy.typing import NDArray

from grainmotion._typing import Progress
from grainmotion.kernels.label_growth import grow
from grainmotion.model.large_arrays import large_empty
from grainmotion.model.progress import counted

VOXELS_GROWN_TOGETHER = 1 << 24
"""Voxels after which progress is told."""


def grown_labels(labels: NDArray[np.integer], reach: float, progress: Progress | None = None) -> NDArray[np.integer]:
    """Voxels without a label get the nearest one that is at most ``reach`` voxels away.

    Of labels equally near that one is taken which comes first along z, then y, then x.  The same as
    `skimage.segmentation.expand_labels` but for these; that one needs 30 bytes a voxel and ten times the time.

    Parameters
    ----------
    labels : (nz, ny, nx) int array
        0 for none.
    reach : float
        Distance, voxels.
    progress : callable, optional
        Called as ``progress(message, done, total)``.

    Returns
    -------
    (nz, ny, nx) int array
        The same array if ``reach`` is below a voxel.
    """
    offsets = _offsets(reach)
    if not len(offsets):
        return labels
    labels = np.ascontiguousarray(labels)
    grown, planes = large_empty(labels.shape, labels.dtype), len(labels)
    together = max(1, VOXELS_GROWN_TOGETHER // max(1, labels[0].size))
    for first in counted(range(0, planes, together)):
        end = min(first + together, planes)
        if progress is not None:
            progress("surfaces of the grains", first, planes)
        grow(labels, offsets, first, end, grown)
    return grown


def _offsets(reach: float) -> NDArray[np.int64]:
    """Steps up to a length, the shortest first."""
    span = range(-int(reach), int(reach) + 1)
    steps = [s for s in itertools.product(span, span, span) if 0 < s[0] ** 2 + s[1] ** 2 + s[2] ** 2 <= reach**2]
    return np.array(sorted(steps, key=lambda s: (s[0] ** 2 + s[1] ** 2 + s[2] ** 2, s)), np.int64).reshape(-1, 3)
