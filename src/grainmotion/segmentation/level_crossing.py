"""Grains through which the surface of a liquid goes: one label instead of one above and one below it.

A porous grain holds liquid below the level and air above it, so that it has two attenuations, which differ by that of
the liquid or by the part of it that fills pores.  Separated level by level it falls apart in a flat, horizontal cut.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from skimage.segmentation import watershed

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


def hosts_across_surface(labels: Ints, level_of: NDArray[np.intp], levels: Levels) -> Ints:
    """Which labels are pieces of one grain, above and below the surface of a liquid.

    Parameters
    ----------
    labels : (nz, ny, nx) int32 array
        0 for no grain.
    level_of : (n + 1,) int array
        Number of each label's level; entry 0 is not used.
    levels : Levels
        Of the same volume.

    Returns
    -------
    (n + 1,) int32 array
        Of each label the largest piece of its grain.
    """
    count, height = len(level_of), _surface(levels)
    new = np.arange(count, dtype=np.int32)
    if height is None or labels.max() < 2:
        return new
    liquid = _liquid_value(levels)
    surface = np.zeros(count)
    keys, places = list[NDArray[np.int64]](), list[NDArray[np.float64]]()
    for axis in range(3):
        own = np.moveaxis(labels, axis, 0)
        a, b = own[:-1], own[1:]
        apart = a != b
        surface += np.bincount(a[apart], minlength=count) + np.bincount(b[apart], minlength=count)
        touch = np.nonzero(apart & (a > 0) & (b > 0))
        lower, upper = a[touch], b[touch]
        keys.append(np.where(lower < upper, lower * np.int64(count) + upper, upper * np.int64(count) + lower))
        places.append(np.asarray(touch[0] + 0.5 if axis == 0 else touch[1], float))
    key, place = np.concatenate(keys), np.concatenate(places)
    on_plane = np.abs(place - height) <= PLANE_VOXELS
    pairs, index, faces = np.unique(key, return_inverse=True, return_counts=True)
    flat = np.bincount(index, on_plane, minlength=len(pairs)) / np.maximum(faces, 1)
    sizes = np.bincount(labels.ravel(), minlength=count)
    layers = np.repeat(np.arange(len(labels)), labels[0].size)
    heights = np.bincount(labels.ravel(), layers, minlength=count) / np.maximum(sizes, 1)
    for k in np.argsort(-faces, kind="stable"):
        one, other = divmod(int(pairs[k]), count)
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


def with_caps(labels: Ints, array: Floats, levels: Levels) -> Ints:
    """Labels that go on through the surface of a liquid into caps of few layers above it, too thin for a core.

    Parameters
    ----------
    labels : (nz, ny, nx) int32 array
        0 for no grain.
    array : (nz, ny, nx) array
        Attenuation, 1/mm.
    levels : Levels
        Of the same volume.

    Returns
    -------
    (nz, ny, nx) int32 array
        Grown by up to `CAP_LAYERS` layers.
    """
    height = _surface(levels)
    if height is None or not levels.solids:
        return labels
    first = int(height + 0.5)
    around = slice(max(first - 1, 0), first + CAP_LAYERS)
    half_way = np.full(len(array[around]), levels.values[levels.solids[0]] / 2)
    half_way[: first + 1 - around.start] += _liquid_value(levels) / 2  # which blur leaves in the first layer
    own = labels[around]
    cap = (own == 0) & (array[around] > half_way[:, None, None].astype(array.dtype))
    cap[: first - around.start] = False
    out = labels.copy()
    out[around] = watershed(-array[around], own, mask=(own > 0) | cap)
    return out


def _liquid_value(levels: Levels) -> float:
    return max(float(levels.values[k]) for k, kind in enumerate(levels.kinds) if kind == "liquid")


def _surface(levels: Levels) -> float | None:
    """Height of the liquid's surface, an index of layers; None if there is no liquid with air above it."""
    if not levels.has_liquid:
        return None
    air, liquid = (
        np.isin(levels.of_voxel, [k for k, kind in enumerate(levels.kinds) if kind == name])
        for name in ("air", "liquid")
    )
    tops = np.count_nonzero(liquid[:-1] & air[1:], axis=(1, 2))
    return float(tops.argmax()) + 0.5 if tops.any() else None
