"""The liquid around the grains of a reference volume: whether there is one, its attenuation, its place, its level.

A liquid shows in the *shell* of a grain, a few voxels outside its label: the attenuation there is clearly above that
of air, the same around every grain below the level, without texture beyond the noise, and connected.  Faint
neighbours, walls and pistons fill a part of a shell only, and fines have texture.
"""

from __future__ import annotations

from dataclasses import replace

import edt
import numpy as np
from numpy.typing import NDArray

from grainmotion._typing import Image
from grainmotion.model.fluid import Fluid, below_level
from grainmotion.model.large_arrays import large_empty
from grainmotion.model.progress import counted
from grainmotion.model.quantiles import median_of_labels
from grainmotion.model.slabs import slabs
from grainmotion.model.volume import Volume
from grainmotion.segmentation.label_measures import boxes_of_labels
from grainmotion.segmentation.liquid_voxels import (
    GROWTH,
    SHELL_VOXELS,
    SKIRT,
    Bools,
    Squares,
    filled_space,
    find_liquid,
    grown_to_border,
    squared_distances,
)

Ints = NDArray[np.int64]

MIN_FLUID_SHARE = 0.08
"""Least attenuation of a liquid over the median of the grains: what lies below is air, blur and streaks."""
MAX_FLUID_SHARE = 0.9
"""Largest attenuation of a liquid over the median of the grains."""
MIN_FILLED_SHELL = 0.5
"""Share of a grain's shell filled by liquid from which the grain is wet."""
MIN_LIT_SHELL = 0.1
"""Share of all shells above `MIN_FLUID_SHARE` below which nothing is looked for: the sample is dry."""
LEVEL_SPREAD = 1.5
"""Voxels by which the tops of the liquid's columns depart from their median where its surface is a level."""
MIN_FLAT_SHARE = 0.6
"""Share of the columns with such tops from which the surface is a level."""
MIN_AIR_LAYERS = 10
"""Layers of air above a level: a liquid that ends nearer to the top of the field is cut by it."""
BLURRED_LAYERS = 2
"""Layers beside a level, or beside the border of the field, whose attenuation is blurred."""
SECTION_LAYERS = 8
"""Layers next to a level or a border of the field whose mean is the cross-section beyond."""
SEEN_SHARE = 0.95
"""Share of the reference's views that must see a place."""
PLANES_OF_SHELLS, SLABS_OF_SHELLS = 32, 12
"""Planes of voxels of which shells are looked at together, and the most of such slabs that tell whether a sample is
dry, evenly along z: already in these a volume of 1000³ voxels has thousands of grains."""


def find_fluid(volume: Volume, labels: NDArray[np.integer], attenuation: float | None = None) -> Fluid | None:
    """The liquid around labelled grains; None if they are dry.

    Parameters
    ----------
    volume : Volume
        Attenuation, 1/mm.
    labels : (nz, ny, nx) int array
        Labels of the grains alone, 0 for anything else.
    attenuation : float, optional
        That of the liquid if it is known, 1/mm.

    Returns
    -------
    Fluid or None
        With the space that it fills, the grains' places included, continued above its level.
    """
    if min(volume.shape) < 2 * SHELL_VOXELS[1] or not labels.any():
        return None
    array = volume.array
    grains = median_of_labels(labels, array)
    if _lit_share(array, labels, MIN_FLUID_SHARE * grains) < MIN_LIT_SHELL:
        return None
    squares = squared_distances(labels)
    if attenuation is None:
        lit = (a[_in_shell(s) & (a > MIN_FLUID_SHARE * grains)] for a, s in zip(array, squares, strict=True))
        attenuation = _level_of_shells(np.concatenate(list(lit)))
    if not MIN_FLUID_SHARE < attenuation / grains < MAX_FLUID_SHARE:
        return None
    found = find_liquid(array, squares, attenuation, grains)
    if found is None:
        return None
    liquid, wall = found
    attenuation = _clear_mean(array, liquid, squares)
    low, high = _seen_layers(volume)
    level = _level(array[: high.max()], liquid[: high.max()], squares, attenuation)
    liquid = grown_to_border(
        liquid, array, lambda planes: (squares[planes] > SKIRT**2) & ~wall[planes], (attenuation, grains)
    )
    shares = _wet_shares(liquid, squares, labels, len(array) if level is None else level)
    wet = np.zeros(int(labels.max()) + 1, bool)
    wet[[label for label, share in shares.items() if share > MIN_FILLED_SHELL]] = True
    if not wet.any():
        return None
    space = filled_space(array, lambda planes: wet[labels[planes]], liquid, squares, attenuation)
    if level is not None:
        low, high = low, np.minimum(high, int(np.floor(level)) - BLURRED_LAYERS)
    _continue(space, low, high)
    height = None if level is None else float(volume.origin[2] + volume.voxel_size * level)
    return Fluid(attenuation, Volume(space, volume.voxel_size, volume.center), height)


def _in_shell(squares: Squares) -> Bools:
    """Voxels in the shell of a label."""
    return (squares >= SHELL_VOXELS[0] ** 2) & (squares <= SHELL_VOXELS[1] ** 2)


def _clear_mean(array: Image, liquid: Bools, squares: Squares) -> float:
    """Mean of the liquid's voxels away from the surfaces of grains."""
    total, count = 0.0, 0
    for values, own, square in zip(array, liquid, squares, strict=True):
        clear = own & (square >= SHELL_VOXELS[0] ** 2)
        total += float(values.sum(dtype=float, where=clear))
        count += int(np.count_nonzero(clear))
    return total / count


def _lit_share(array: Image, labels: NDArray[np.integer], lit: float) -> float:
    """Share of the shells' voxels above a level, from a few planes at a time, not all of many: most samples are dry."""
    margin = int(np.ceil(SHELL_VOXELS[1])) + 1
    each = list(slabs(len(array), margin, PLANES_OF_SHELLS))
    above = total = 0
    for around, inner in counted(each[:: -(-len(each) // SLABS_OF_SHELLS)]):
        outside = edt.edt((labels[around] == 0).astype(np.uint8), parallel=1)[inner]
        values = array[around][inner][(outside >= SHELL_VOXELS[0]) & (outside <= SHELL_VOXELS[1])]
        above += int(np.count_nonzero(values > lit))
        total += len(values)
    return above / total if total else 0.0


def _level_of_shells(values: Image) -> float:
    """The attenuation that most voxels of the shells have, 1/mm: the half-sample mode, then the mean around it."""
    values = np.sort(values)
    while len(values) > 50:
        n = (len(values) + 1) // 2
        k = int(np.argmin(values[n - 1 :] - values[: len(values) - n + 1]))
        values = values[k : k + n]
    return float(values.mean())


def _wet_shares(liquid: Bools, squares: Squares, labels: NDArray[np.integer], surface: float) -> dict[int, float]:
    """Share of each grain's shell below the liquid's ``surface`` (index of layers) that the liquid fills."""
    shares, margin = dict[int, float](), int(np.ceil(SHELL_VOXELS[1]))
    for label, box in enumerate(boxes_of_labels(labels), start=1):
        if box is None or box[0].start > surface:
            continue
        around = tuple(slice(max(s.start - margin, 0), s.stop + margin) for s in box)
        own = edt.edt((labels[around] != label).astype(np.uint8), parallel=1)
        mine = _in_shell(squares[around]) & (own <= SHELL_VOXELS[1])
        mine[max(int(np.floor(surface)) - around[0].start, 0) :] = False
        if mine.any():
            shares[label] = float(liquid[around][mine].mean())
    return shares


def _level(array: Image, liquid: Bools, squares: Squares, attenuation: float) -> float | None:
    """Height of the liquid's flat surface, as an index of layers; None if it has none within the field."""
    layers = len(array)
    top = np.full(array.shape[1:], -1)
    for z, plane in enumerate(liquid):
        top[plane] = z
    beyond = np.minimum(top + GROWTH + 1, layers - 1)
    y, x = np.nonzero((top >= 0) & (top < layers - MIN_AIR_LAYERS))
    open_to_air = array[beyond[y, x], y, x] < attenuation / 2
    if not open_to_air.any() or (top >= layers - MIN_AIR_LAYERS).sum() > len(y):
        return None
    y, x = y[open_to_air], x[open_to_air]
    middle = float(np.median(top[y, x]))
    flat = np.abs(top[y, x] - middle) <= LEVEL_SPREAD
    if flat.mean() < MIN_FLAT_SHARE:
        return None
    first, last = max(int(middle) - 4, 0), min(int(middle) + 7, layers)
    y, x = y[flat], x[flat]
    clear = (squares[first:last, y, x] > SKIRT**2).all(axis=0)
    if not clear.any():
        return middle + 0.5
    shares = array[first:last, y[clear], x[clear]].mean(axis=1, dtype=float) / attenuation
    return first - 0.5 + float(np.clip(shares, 0, 1.2).sum())


def _seen_layers(volume: Volume) -> tuple[Ints, Ints]:
    """First layer that nearly all views of the scan saw above each place (y, x), and the one past the last."""
    layers, ny, nx = volume.shape
    first, last = np.zeros((ny, nx), np.int64), np.full((ny, nx), layers, np.int64)
    if volume.field is None:
        return first, last
    y, x = np.mgrid[:ny, :nx]
    places = volume.origin[:2] + volume.voxel_size * np.column_stack([x.ravel(), y.ravel()])
    low, high = (
        ((heights - volume.origin[2]) / volume.voxel_size).reshape(ny, nx)
        for heights in volume.field.border_heights(places, SEEN_SHARE)
    )
    first = np.clip(np.nan_to_num(np.ceil(low) + BLURRED_LAYERS, neginf=0), 0, layers).astype(np.int64)
    last = np.clip(np.nan_to_num(np.floor(high) - BLURRED_LAYERS + 1, posinf=layers), 0, layers).astype(np.int64)
    return first, np.maximum(last, first)


def _continue(space: Image, first: Ints, last: Ints) -> None:
    """Continue the space's cross-section, in place, above and below the layers that are known above each place."""
    if first.max() <= 0 and last.min() >= len(space):
        return
    for below in (True, False):
        total, count = np.zeros(first.shape), np.zeros(first.shape, np.int64)
        for z, plane in enumerate(space):
            here = (z >= first) & (z < last) & (z < first + SECTION_LAYERS if below else z >= last - SECTION_LAYERS)
            total += np.where(here, plane, 0)
            count += here
        section = total / np.maximum(count, 1)
        for z, plane in enumerate(space):
            np.copyto(plane, section, where=z < first if below else z >= last, casting="same_kind")


def without_fluid(volume: Volume, fluid: Fluid, labels: NDArray[np.integer]) -> Volume:
    """A volume without its liquid: grains hold their excess over it.

    Where the liquid goes on beyond what the scan saw, nothing is left of it.
    """
    rest, space = large_empty(volume.shape, volume.array.dtype), fluid.space
    first, last = _seen_layers(volume)
    heights = space.origin[2] + space.voxel_size * np.arange(space.shape[0])
    below = fluid.attenuation * below_level(heights, fluid.surface, space.voxel_size).astype(space.array.dtype)
    for z, (plane, array, filled) in enumerate(zip(rest, volume.array, space.array, strict=True)):
        np.subtract(array, filled * below[z], out=plane, casting="same_kind")
        plane[((z < first) | (z >= last)) & (labels[z] == 0) & (filled > 0)] = 0
    return replace(volume, array=rest)
