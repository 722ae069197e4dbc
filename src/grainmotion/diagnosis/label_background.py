"""Air or liquid around the grains that has a label of its own, as after a watershed without a mask."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from grainmotion.model.volume import Volume

MIN_SURROUNDING_SHARE = 0.15
"""Share of all voxels from which the largest label may be what is around the grains."""
MAX_SURROUNDING_LEVEL = 0.5
"""Its mean attenuation over that of the other labels, above the darkest voxels, up to which it is."""
MAX_ABOVE_UNLABELLED = 0.1
"""By how much it may attenuate more than what has no label, in the same units: a labelled tube does, air does not."""
MIN_UNLABELLED_SHARE = 0.01
"""Share of all voxels from which those without a label are compared."""


def background_label(volume: Volume, labels: NDArray[np.integer]) -> tuple[int, float, float] | None:
    """The largest label if it is what is around the grains, its share of all voxels, and its attenuation over theirs.

    Without other labels it is compared with what has none: grain and air are swapped then.
    """
    sizes = np.bincount(labels.ravel())
    sizes[0] = 0
    label = int(sizes.argmax())
    share = float(sizes[label]) / labels.size
    inside = labels == label
    others = (labels > 0) & ~inside
    others = others if others.any() else ~inside
    if share < MIN_SURROUNDING_SHARE or not others.any() or not _surrounds(inside):
        return None
    dark = float(np.quantile(volume.array, 0.01))
    level, grains = (float(volume.array[mask].mean(dtype=float)) - dark for mask in (inside, others))
    if grains <= 0 or level > MAX_SURROUNDING_LEVEL * grains:
        return None
    unlabelled = labels == 0
    if unlabelled.mean() >= MIN_UNLABELLED_SHARE:
        around = float(volume.array[unlabelled].mean(dtype=float)) - dark
        if level > around + MAX_ABOVE_UNLABELLED * grains:
            return None
    return label, share, max(level, 0.0) / grains


def _surrounds(inside: NDArray[np.bool_]) -> bool:
    """Whether a label reaches at least four faces of the array, along axes of more than one voxel."""
    faces = [
        face for axis in range(3) if inside.shape[axis] > 1 for face in (inside.take(0, axis), inside.take(-1, axis))
    ]
    return sum(bool(face.any()) for face in faces) >= min(4, len(faces))
