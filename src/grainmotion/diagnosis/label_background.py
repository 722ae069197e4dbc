"""Air or liquid around the grains that has a label of its own, as after a watershed without a mask."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from grainmotion.model.label_sums import label_sizes, label_sums
from grainmotion.model.quantiles import quantile_of_parts
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
    sizes = label_sizes(labels)
    total, bare = labels.size, int(sizes[0])
    sizes[0] = 0
    label = int(sizes.argmax())
    share = float(sizes[label]) / total
    swapped = int(sizes.sum()) == int(sizes[label])
    others = total - sizes[label] if swapped else sizes.sum() - sizes[label]
    if share < MIN_SURROUNDING_SHARE or not others or not _surrounds(labels, label):
        return None
    sums = label_sums(labels, volume.array)
    of_others = sums.sum() - sums[label] - (0 if swapped else sums[0])
    dark = quantile_of_parts(lambda: volume.array, 0.01)
    level, grains = float(sums[label] / sizes[label]) - dark, float(of_others / others) - dark
    if grains <= 0 or level > MAX_SURROUNDING_LEVEL * grains:
        return None
    if bare >= MIN_UNLABELLED_SHARE * total:
        around = float(sums[0] / bare) - dark
        if level > around + MAX_ABOVE_UNLABELLED * grains:
            return None
    return label, share, max(level, 0.0) / grains


def _surrounds(labels: NDArray[np.integer], label: int) -> bool:
    """Whether a label reaches at least four faces of the array, along axes of more than one voxel."""
    faces = [
        face for axis in range(3) if labels.shape[axis] > 1 for face in (labels.take(0, axis), labels.take(-1, axis))
    ]
    return sum(bool((face == label).any()) for face in faces) >= min(4, len(faces))
