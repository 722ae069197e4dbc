"""Grains through which the surface of a liquid goes: one label instead of one above and one below it.

A porous grain holds liquid below the level and air above it, so that it has two attenuations, which differ by that of
the liquid or by the part of it that fills pores.  Separated level by level it falls apart in a flat, horizontal cut.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from grainmotion.segmentation.blocks import Work
from grainmotion.segmentation.flooding import grow_labels
from grainmotion.segmentation.label_measures import highest_label, label_sizes
from grainmotion.segmentation.label_pairs import LabelPairs
from grainmotion.segmentation.phases import Levels
from grainmotion.segmentation.uniform_cores import Floats, Ints

MIN_CUT = 0.15
"""Share of the surface of the smaller piece in the cut: 1/3 of a ball cut in half, up to 0.13 where grains touch."""
MIN_ON_PLANE = 0.8
"""Share of the faces between the pieces that lie on the liquid's surface, within `PLANE_VOXELS`."""
PLANE_VOXELS = 2.0
"""Voxels by which the cut departs from its plane."""
MAX_STEP_OVER_LIQUID = 1.2
"""Largest difference of the two attenuations over that of the liquid."""
MIN_AREA = 9
"""Faces of a cut."""
CAP_LAYERS = 3
"""Layers above the surface where a cap may be."""


def hosts_across_surface(labels: Ints, level_of: NDArray[np.intp], levels: Levels, work: Work) -> Ints:
    """Which labels are pieces of one grain, above and below the surface of a liquid.

    Parameters
    ----------
    labels : (nz, ny, nx) int32 array
        0 for no grain.
    level_of : (n + 1,) int array
        Number of each label's level; entry 0 is not used.
    levels : Levels
        Of the same volume.
    work : Work
        Threads.

    Returns
    -------
    (n + 1,) int32 array
        Of each label the largest piece of its grain.
    """
    count, height = len(level_of), _surface(levels, work)
    new = np.arange(count, dtype=np.int32)
    if height is None or count < 3:
        return new
    liquid = _liquid_value(levels)
    touching = LabelPairs.of(labels, labels, count - 1, work)
    pairs, faces, surface = touching.pairs, touching.faces.sum(axis=1), touching.surface
    flat = _faces_on_plane(labels, pairs, count, height, work) / np.maximum(faces, 1)
    sizes, heights = label_sizes(labels, count - 1, work), _mean_layers(labels, count, work)
    for k in np.argsort(-faces, kind="stable"):
        one, other = pairs[k].tolist()
        above, below = (one, other) if heights[one] > heights[other] else (other, one)
        step = float(levels.values[level_of[below]] - levels.values[level_of[above]])
        cut = faces[k] / max(min(surface[one], surface[other]), 1)
        if (
            0 < step <= MAX_STEP_OVER_LIQUID * liquid
            and faces[k] >= MIN_AREA
            and cut > MIN_CUT
            and flat[k] > MIN_ON_PLANE
        ):
            roots = sorted((int(new[one]), int(new[other])), key=lambda label: sizes[label])
            new[new == roots[0]] = roots[1]
    return new


def _faces_on_plane(labels: Ints, pairs: NDArray[np.int64], count: int, height: float, work: Work) -> NDArray[np.int64]:
    """Faces of each pair within `PLANE_VOXELS` of the liquid's surface."""
    low, high = int(np.ceil(height - PLANE_VOXELS)), int(np.floor(height + PLANE_VOXELS)) + 1
    found = dict[tuple[int, int], int]()
    # faces across z between layers k and k + 1 lie at k + 0.5
    first, last = int(np.ceil(height - PLANE_VOXELS - 0.5)), int(np.floor(height + PLANE_VOXELS - 0.5)) + 2
    for layers, axes in ((slice(max(first, 0), max(last, 0)), [0]), (slice(max(low, 0), max(high, 0)), [1, 2])):
        near = LabelPairs.of(labels[layers], labels[layers], count - 1, work)
        for pair, faces in zip(near.pairs.tolist(), near.faces[:, axes].sum(axis=1).tolist(), strict=True):
            found[pair[0], pair[1]] = found.get((pair[0], pair[1]), 0) + faces
    return np.array([found.get((a, b), 0) for a, b in pairs.tolist()], np.int64)


def _mean_layers(labels: Ints, count: int, work: Work) -> NDArray[np.float64]:
    """Mean layer of the voxels of each label."""

    def add(layer: int, found: NDArray[np.int64]) -> NDArray[np.int64]:
        voxels = np.bincount(labels[layer].ravel(), minlength=count)
        return found + np.stack([voxels, layer * voxels])

    parts = work.gathered(range(len(labels)), lambda: np.zeros((2, count), np.int64), add)
    voxels, sums = np.asarray(sum(parts))
    return np.asarray(sums / np.maximum(voxels, 1))


def grow_caps(labels: Ints, array: Floats, levels: Levels, work: Work) -> None:
    """Let labels go on, in place, through the surface of a liquid into caps of few layers, too thin for a core.

    Parameters
    ----------
    labels : (nz, ny, nx) int32 array
        0 for no grain; they grow by up to `CAP_LAYERS` layers.
    array : (nz, ny, nx) array
        Attenuation, 1/mm.
    levels : Levels
        Of the same volume.
    work : Work
        Threads.
    """
    height = _surface(levels, work)
    if height is None or not levels.solids:
        return
    first = int(height + 0.5)
    around = slice(max(first - 1, 0), first + CAP_LAYERS)
    half_way = np.full(len(array[around]), levels.values[levels.solids[0]] / 2)
    half_way[: first + 1 - around.start] += _liquid_value(levels) / 2  # which blur leaves in the first layer
    own = labels[around]
    cap = (own == 0) & (array[around] > half_way[:, None, None].astype(array.dtype))
    cap[: first - around.start] = False
    own[cap] = -1
    grow_labels(own, array[around], highest_label(labels, work), work)


def _liquid_value(levels: Levels) -> float:
    return max(float(levels.values[k]) for k, kind in enumerate(levels.kinds) if kind == "liquid")


def _surface(levels: Levels, work: Work) -> float | None:
    """Height of the liquid's surface, an index of layers; None if there is no liquid with air above it."""
    if not levels.has_liquid:
        return None
    is_air, is_liquid = (np.array([kind == name for kind in levels.kinds]) for name in ("air", "liquid"))
    layers = levels.of_voxel

    def count(layer: int) -> int:
        return int(np.count_nonzero(is_liquid[layers[layer]] & is_air[layers[layer + 1]]))

    tops = np.array(work.each(range(len(layers) - 1), count))
    return float(tops.argmax()) + 0.5 if tops.any() else None
