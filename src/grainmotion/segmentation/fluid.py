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
from scipy import ndimage
from skimage.filters import threshold_otsu

from grainmotion._typing import Image
from grainmotion.model.fluid import Fluid
from grainmotion.model.volume import Volume

Bools = NDArray[np.bool_]
Ints = NDArray[np.int64]

SHELL_VOXELS = (2.0, 4.0)
"""Distances from a label between which voxels show what surrounds it, free of the blur of its surface, voxels."""
MIN_FLUID_SHARE = 0.08
"""Least attenuation of a liquid over the median of the grains: what lies below is air, blur and streaks."""
MAX_FLUID_SHARE = 0.9
"""Largest attenuation of a liquid over the median of the grains."""
MIN_FILLED_SHELL = 0.5
"""Share of a grain's shell filled by liquid from which the grain is wet."""
MIN_LIT_SHELL = 0.1
"""Share of all shells above `MIN_FLUID_SHARE` below which nothing is looked for: the sample is dry."""
LIQUID_SIGMA = 1.5
"""Width of the Gaussian filter under which a liquid is uniform, voxels: the noise of voxels averages out, texture of
fines does not."""
MAX_TEXTURE = 0.12
"""Departure (rms) of the filtered attenuation from the liquid's, over it: 0.03 to 0.05 measured for noise of 10 %."""
TOLERANCE = 0.3
"""Departure of filtered attenuation from the liquid's up to which a voxel is liquid, over the liquid's; a part of the
gap to the grains at most."""
MIN_WALL_STEP, MIN_WALL_SEPARABILITY = 0.06, 0.7
"""A wall about as dense as the liquid that it touches: difference of their filtered attenuations over the liquid's, and
share of the variance of all that it explains, from which they are two.  Measured for a wall of three quarters of the
liquid's attenuation: 0.13 and 0.82, for a liquid alone 0.02 and 0.51 to 0.58."""
MAX_GAP_SHARE = 0.4
"""The same over the gap between liquid and grains."""
SKIRT = 1.5
"""Distance from a label up to which voxels hold the blur of its surface, voxels."""
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
CLOSING = 6.0
"""Radius of the ball that does not enter gaps between the liquid and grains, voxels: films beside a container's wall
that are too thin to show are closed."""
MAX_EDGE_SHARE = 1.25
"""Largest share of a voxel at the liquid's border with air: above 1 by noise, which a cut at 1 would make a loss."""
PLANES_OF_SHELLS = 64
"""Planes of voxels of which shells are looked at together."""
GROWTH = 3
"""Layers of voxels by which the liquid is grown to its border, halfway to the attenuation of air or grains."""
EDGE = 2
"""Voxels beyond the liquid over which its own edge is blurred."""


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
    grains = float(np.median(array[labels > 0]))
    if _lit_share(array, labels, MIN_FLUID_SHARE * grains) < MIN_LIT_SHELL:
        return None
    outside = edt.edt((labels == 0).astype(np.uint8), parallel=1)
    shell = (outside >= SHELL_VOXELS[0]) & (outside <= SHELL_VOXELS[1])
    values = array[shell]
    if attenuation is None:
        attenuation = _level_of_shells(values[values > MIN_FLUID_SHARE * grains])
    if not MIN_FLUID_SHARE < attenuation / grains < MAX_FLUID_SHARE:
        return None
    found = _liquid(array, outside, attenuation, grains)
    if found is None:
        return None
    liquid, wall = found
    attenuation = float(np.mean(array[liquid & (outside >= SHELL_VOXELS[0])], dtype=float))
    low, high = _seen_layers(volume)
    level = _level(array[: high.max()], liquid[: high.max()], outside, attenuation)
    liquid = _to_its_border(liquid, array, (outside > SKIRT) & ~wall, attenuation, grains)
    shares = _wet_shares(liquid, shell, labels, len(array) if level is None else level)
    wet = [label for label, share in shares.items() if share > MIN_FILLED_SHELL]
    if not wet:
        return None
    space = _space(array, np.isin(labels, wet), liquid, outside, attenuation)
    if level is not None:
        low, high = low, np.minimum(high, int(np.floor(level)) - BLURRED_LAYERS)
    space = _continued(space, low, high)
    height = None if level is None else float(volume.origin[2] + volume.voxel_size * level)
    return Fluid(attenuation, Volume(space, volume.voxel_size, volume.center), height)


def _lit_share(array: Image, labels: NDArray[np.integer], lit: float) -> float:
    """Share of the shells' voxels above a level, from a few planes at a time: most samples are dry."""
    margin = int(np.ceil(SHELL_VOXELS[1])) + 1
    above = total = 0
    for first in range(0, len(array), PLANES_OF_SHELLS):
        end = min(first + PLANES_OF_SHELLS, len(array))
        low = max(first - margin, 0)
        outside = edt.edt((labels[low : end + margin] == 0).astype(np.uint8), parallel=1)[first - low : end - low]
        values = array[first:end][(outside >= SHELL_VOXELS[0]) & (outside <= SHELL_VOXELS[1])]
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


def _liquid(array: Image, outside: Image, attenuation: float, grains: float) -> tuple[Bools, Bools] | None:
    """Voxels of the largest connected piece of liquid outside the grains' blurred surfaces, and of a wall beside it.

    None if it has texture.
    """
    free = outside > SKIRT
    weight = ndimage.gaussian_filter(free.astype(np.float32), LIQUID_SIGMA, truncate=2.0)
    smooth = ndimage.gaussian_filter(np.where(free, array, 0).astype(np.float32), LIQUID_SIGMA, truncate=2.0)
    smooth = np.where(free, smooth / np.maximum(weight, 1e-3), 0)
    tolerance = min(TOLERANCE * attenuation, MAX_GAP_SHARE * max(grains - attenuation, 0.0))
    liquid = free & (np.abs(smooth - attenuation) < tolerance)
    pieces, n = ndimage.label(liquid)
    if n == 0:
        return None
    liquid = pieces == 1 + int(np.argmax(np.bincount(pieces.ravel())[1:]))
    wall = _wall_beside(smooth, liquid, outside, attenuation)
    liquid &= ~wall
    inner = _closed(liquid | (outside <= SKIRT), CLOSING)
    inner = ndimage.binary_erosion(inner, iterations=EDGE, border_value=1) & (outside >= SHELL_VOXELS[0])
    beside = np.maximum.accumulate(liquid, axis=0) & np.maximum.accumulate(liquid[::-1], axis=0)[::-1]
    inner &= ndimage.binary_erosion(beside, iterations=EDGE, border_value=1)  # not above a level
    departure = smooth[inner] - attenuation
    if not inner.any() or float(np.sqrt(np.mean(departure**2, dtype=float))) > MAX_TEXTURE * attenuation:
        return None
    return np.asarray(liquid), wall


def _wall_beside(smooth: Image, liquid: Bools, outside: Image, attenuation: float) -> Bools:
    """Voxels of what was taken for ``liquid`` that are of something else, about as dense: none, or a wall."""
    deep = ndimage.binary_erosion(liquid | (outside <= SHELL_VOXELS[0]), iterations=GROWTH, border_value=1) & liquid
    values = smooth[deep]  # away from air, whose blur is no wall
    if values.size < 2 or np.ptp(values) == 0:
        return np.zeros_like(liquid)
    limit = float(threshold_otsu(values))
    low, high = values[values <= limit], values[values > limit]
    step = float(high.mean() - low.mean())
    between = len(low) * len(high) / len(values) ** 2 * step**2
    if step < MIN_WALL_STEP * attenuation or between < MIN_WALL_SEPARABILITY * values.var():
        return np.zeros_like(liquid)
    denser = abs(low.mean() - attenuation) < abs(high.mean() - attenuation)
    other = (smooth > limit) if denser else (smooth <= limit)
    return np.asarray(ndimage.binary_dilation(deep & other, iterations=GROWTH) & liquid & other)


def _to_its_border(liquid: Bools, array: Image, free: Bools, attenuation: float, grains: float) -> Bools:
    """The liquid grown over the layers that the filter blurred and that are ``free``, halfway to air or grains."""
    clear = free & (array > attenuation / 2) & (array < (attenuation + grains) / 2)
    return np.asarray(ndimage.binary_dilation(liquid, iterations=GROWTH, mask=clear | liquid))


def _wet_shares(liquid: Bools, shell: Bools, labels: NDArray[np.integer], surface: float) -> dict[int, float]:
    """Share of each grain's shell below the liquid's ``surface`` (index of layers) that the liquid fills."""
    shares, margin = dict[int, float](), int(np.ceil(SHELL_VOXELS[1]))
    for label, box in enumerate(ndimage.find_objects(labels), start=1):
        if box is None or box[0].start > surface:
            continue
        around = tuple(slice(max(s.start - margin, 0), s.stop + margin) for s in box)
        own = edt.edt((labels[around] != label).astype(np.uint8), parallel=1)
        mine = shell[around] & (own <= SHELL_VOXELS[1])
        mine[max(int(np.floor(surface)) - around[0].start, 0) :] = False
        if mine.any():
            shares[label] = float(liquid[around][mine].mean())
    return shares


def _space(array: Image, wet_grains: Bools, liquid: Bools, outside: Image, attenuation: float) -> Image:
    """Share of each voxel that liquid and the grains within it fill, up to the liquid's level.

    Within the liquid it is 1, at its border with air the share that the attenuation shows, so that no attenuation is
    lost.  Wet grains and their blurred surfaces belong to it, and gaps that a ball of `CLOSING` voxels does not enter.
    """
    hidden = outside <= SKIRT
    inside = liquid | wet_grains
    closed = _closed(inside, CLOSING)
    inside |= closed & (hidden | (array > attenuation / 2))
    around = ndimage.binary_dilation(inside, iterations=EDGE)
    air = ndimage.minimum_filter(np.where(hidden, attenuation, array), size=2 * EDGE + 1) < attenuation / 4
    space = inside.astype(np.float32)
    edge = around & air & ~hidden
    space[edge] = np.clip(array[edge] / attenuation, 0, MAX_EDGE_SHARE)
    # what blur leaves beside a grain at the liquid's border cannot be told apart, and is given to the liquid
    edge = around & air & hidden & (outside > 0)
    space[edge] = np.clip(array[edge] / attenuation, 0, 1)
    return space


def _closed(inside: Bools, radius: float) -> Bools:
    """Morphological closing by a ball, in voxels; what lies beyond the array continues its faces."""
    n = int(np.ceil(radius)) + 1
    padded = np.pad(inside, n, mode="edge")
    grown = edt.edt((~padded).astype(np.uint8), parallel=1) <= radius
    shrunk = edt.edt(grown.astype(np.uint8), parallel=1) > radius
    return np.asarray(shrunk[n:-n, n:-n, n:-n])


def _level(array: Image, liquid: Bools, outside: Image, attenuation: float) -> float | None:
    """Height of the liquid's flat surface, as an index of layers; None if it has none within the field."""
    layers = len(array)
    z = np.arange(layers)[:, None, None]
    top = np.where(liquid, z, -1).max(axis=0)
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
    clear = (outside[first:last, y, x] > SKIRT).all(axis=0)
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


def _continued(space: Image, first: Ints, last: Ints) -> Image:
    """The space with its cross-section continued above and below the layers that are known above each place."""
    z = np.arange(len(space))[:, None, None]
    known = (z >= first) & (z < last)
    if known.all():
        return space
    out = space.copy()
    for beyond, near in ((z < first, z < first + SECTION_LAYERS), (z >= last, z >= last - SECTION_LAYERS)):
        here = known & near
        section = np.where(here, space, 0).sum(axis=0) / np.maximum(here.sum(axis=0), 1)
        out = np.where(beyond, section, out)
    return out.astype(space.dtype)


def without_fluid(volume: Volume, fluid: Fluid, labels: NDArray[np.integer]) -> Volume:
    """A volume without its liquid: grains hold their excess over it.

    Where the liquid goes on beyond what the scan saw, nothing is left of it.
    """
    rest = volume.array - fluid.volume.array
    first, last = _seen_layers(volume)
    z = np.arange(len(rest))[:, None, None]
    unseen = ((z < first) | (z >= last)) & (labels == 0) & (fluid.space.array > 0)
    return replace(volume, array=np.where(unseen, 0, rest).astype(rest.dtype))
