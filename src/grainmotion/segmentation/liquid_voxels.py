"""Voxels of a liquid around labelled grains, found some planes at a time, and the space that it fills."""

from __future__ import annotations

from collections.abc import Callable

import edt
import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from grainmotion._typing import Image
from grainmotion.model.large_arrays import large_empty
from grainmotion.model.slabs import slabs
from grainmotion.preprocessing.volume_threshold import otsu
from grainmotion.segmentation.blocks import Work
from grainmotion.segmentation.components import Components

Bools = NDArray[np.bool_]
Squares = NDArray[np.uint8]
"""Squared distance of each voxel from the nearest label, voxels; `FAR_SQUARE` and more are one."""

SHELL_VOXELS = (2.0, 4.0)
"""Distances from a label between which voxels show what surrounds it, free of the blur of its surface, voxels."""
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
CLOSING = 6.0
"""Radius of the ball that does not enter gaps between the liquid and grains, voxels: films beside a container's wall
that are too thin to show are closed."""
MAX_EDGE_SHARE = 1.25
"""Largest share of a voxel at the liquid's border with air: above 1 by noise, which a cut at 1 would make a loss."""
GROWTH = 3
"""Layers of voxels by which the liquid is grown to its border, halfway to the attenuation of air or grains."""
EDGE = 2
"""Voxels beyond the liquid over which its own edge is blurred."""
FAR_SQUARE = 25
"""Squared distance from which it does not matter."""
PLANES_CLOSED = 128
"""Planes of voxels that are closed together: many against the reach of the closing."""


def squared_distances(labels: NDArray[np.integer]) -> Squares:
    """Squared distance of each voxel from the nearest label, voxels."""
    out = large_empty(labels.shape, np.uint8)
    for around, inner in slabs(len(labels), int(FAR_SQUARE**0.5) + 1):
        distance = edt.edtsq((labels[around] == 0).astype(np.uint8), parallel=1)[inner]
        out[own_planes(around, inner)] = np.minimum(distance, FAR_SQUARE)
    return out


def own_planes(around: slice, inner: slice) -> slice:
    """The planes of a slab without its margin, in the volume."""
    return slice(around.start + inner.start, around.start + inner.stop)


def find_liquid(array: Image, squares: Squares, attenuation: float, grains: float) -> tuple[Bools, Bools] | None:
    """Voxels of the largest connected piece of liquid outside the grains' blurred surfaces, and of a wall beside it.

    None if it has texture.
    """
    tolerance = min(TOLERANCE * attenuation, MAX_GAP_SHARE * max(grains - attenuation, 0.0))
    smooth, liquid = large_empty(array.shape, np.float32), np.empty(array.shape, bool)
    for around, inner in slabs(len(array), int(2 * LIQUID_SIGMA + 0.5)):
        free, here = squares[around] > SKIRT**2, own_planes(around, inner)
        weight = ndimage.gaussian_filter(free.astype(np.float32), LIQUID_SIGMA, truncate=2.0)[inner]
        values = np.where(free, array[around], 0).astype(np.float32)
        values = ndimage.gaussian_filter(values, LIQUID_SIGMA, truncate=2.0)[inner]
        smooth[here] = np.where(free[inner], values / np.maximum(weight, 1e-3), 0)
        liquid[here] = free[inner] & (np.abs(smooth[here] - attenuation) < tolerance)
    work = Work()
    pieces = Components.of(liquid, work)
    if not len(pieces.sizes):
        return None
    liquid[...] = False
    pieces.paint(liquid.view(np.uint8), (np.arange(len(pieces.sizes)) == pieces.sizes.argmax()).astype(np.uint8), work)
    del pieces
    wall = _wall_beside(smooth, liquid, squares, attenuation)
    liquid &= ~wall
    departure = _departure(smooth, liquid, squares, attenuation)
    return (liquid, wall) if departure <= MAX_TEXTURE * attenuation else None


def _departure(smooth: Image, liquid: Bools, squares: Squares, attenuation: float) -> float:
    """Root mean square of the filtered liquid's departure within, away from its borders; infinite if there is none."""
    lowest, highest = _ends(liquid)
    total, count = 0.0, 0
    for around, inner in slabs(len(liquid), closing_reach() + EDGE, PLANES_CLOSED):
        closed = _closed(liquid[around] | (squares[around] <= SKIRT**2), CLOSING)
        z = np.arange(around.start, around.stop)[:, None, None]
        beside = (z >= lowest) & (z <= highest)  # not above a level
        here = own_planes(around, inner)
        deep = ndimage.binary_erosion(closed, iterations=EDGE, border_value=1)[inner]
        deep &= ndimage.binary_erosion(beside, iterations=EDGE, border_value=1)[inner]
        values = smooth[here][deep & (squares[here] >= SHELL_VOXELS[0] ** 2)]
        total += float(np.sum((values - attenuation) ** 2, dtype=float))
        count += len(values)
    return float(np.sqrt(total / count)) if count else np.inf


def _ends(liquid: Bools) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Lowest and highest plane of liquid in each column; none in a column without any."""
    lowest, highest = np.full(liquid.shape[1:], len(liquid)), np.full(liquid.shape[1:], -1)
    for z, plane in enumerate(liquid):
        highest[plane] = z
        np.minimum(lowest, z, out=lowest, where=plane)
    return lowest, highest


def _wall_beside(smooth: Image, liquid: Bools, squares: Squares, attenuation: float) -> Bools:
    """Voxels of what was taken for ``liquid`` that are of something else, about as dense: none, or a wall."""
    deep, wall = np.empty_like(liquid), np.zeros_like(liquid)
    for around, inner in slabs(len(liquid), GROWTH):
        within = liquid[around] | (squares[around] <= SHELL_VOXELS[0] ** 2)
        within = ndimage.binary_erosion(within, iterations=GROWTH, border_value=1)
        deep[own_planes(around, inner)] = within[inner] & liquid[own_planes(around, inner)]
    values = smooth[deep]  # away from air, whose blur is no wall
    if values.size < 2 or np.ptp(values) == 0:
        return wall
    limit = otsu(values)
    dense = values > limit
    count = int(np.count_nonzero(dense))
    low, high = (float(values.mean(dtype=float, where=chosen)) for chosen in (~dense, dense))
    between = count * (len(values) - count) / len(values) ** 2 * (high - low) ** 2
    if high - low < MIN_WALL_STEP * attenuation or between < MIN_WALL_SEPARABILITY * values.var():
        return wall
    del values, dense
    denser = abs(low - attenuation) < abs(high - attenuation)
    for around, inner in slabs(len(liquid), GROWTH):
        other = (smooth[around] > limit) if denser else (smooth[around] <= limit)
        grown = ndimage.binary_dilation(deep[around] & other, iterations=GROWTH) & liquid[around] & other
        wall[own_planes(around, inner)] = grown[inner]
    return wall


def grown_to_border(liquid: Bools, array: Image, free: Callable[[slice], Bools], levels: tuple[float, float]) -> Bools:
    """The liquid grown over layers that the filter blurred, halfway to air or grains.

    Parameters
    ----------
    liquid : (nz, ny, nx) bool array
        Voxels of the liquid.
    array : (nz, ny, nx) array
        Attenuation, 1/mm.
    free : callable
        Voxels of some planes that may be liquid.
    levels : (float, float)
        Attenuation of liquid and grains, 1/mm.

    Returns
    -------
    (nz, ny, nx) bool array
        With up to `GROWTH` layers more.
    """
    out, (low, high) = np.empty_like(liquid), levels
    for around, inner in slabs(len(liquid), GROWTH):
        clear = free(around) & (array[around] > low / 2) & (array[around] < (low + high) / 2)
        grown = ndimage.binary_dilation(liquid[around], iterations=GROWTH, mask=clear | liquid[around])
        out[own_planes(around, inner)] = grown[inner]
    return out


def filled_space(
    array: Image, wet: Callable[[slice], Bools], liquid: Bools, squares: Squares, attenuation: float
) -> Image:
    """Share of each voxel that liquid and the grains within it fill, up to the liquid's level.

    Within the liquid it is 1, at its border with air the share that the attenuation shows, so that no attenuation is
    lost.  Wet grains and their blurred surfaces belong to it, and gaps that a ball of `CLOSING` voxels does not enter.

    Parameters
    ----------
    array : (nz, ny, nx) array
        Attenuation, 1/mm.
    wet : callable
        Voxels of wet grains in some planes.
    liquid : (nz, ny, nx) bool array
        Voxels of the liquid.
    squares : (nz, ny, nx) uint8 array
        See `squared_distances`.
    attenuation : float
        Of the liquid, 1/mm.

    Returns
    -------
    (nz, ny, nx) float32 array
        0 to `MAX_EDGE_SHARE`.
    """
    space = large_empty(array.shape, np.float32)
    for around, inner in slabs(len(array), closing_reach() + 2 * EDGE, PLANES_CLOSED):
        values, hidden = array[around], squares[around] <= SKIRT**2
        inside = liquid[around] | wet(around)
        inside |= _closed(inside, CLOSING) & (hidden | (values > attenuation / 2))
        near = ndimage.binary_dilation(inside, iterations=EDGE)
        air = ndimage.minimum_filter(np.where(hidden, attenuation, values), size=2 * EDGE + 1) < attenuation / 4
        part = inside.astype(np.float32)
        edge = near & air & ~hidden
        part[edge] = np.clip(values[edge] / attenuation, 0, MAX_EDGE_SHARE)
        # what blur leaves beside a grain at the liquid's border cannot be told apart, and is given to the liquid
        edge = near & air & hidden & (squares[around] > 0)
        part[edge] = np.clip(values[edge] / attenuation, 0, 1)
        space[own_planes(around, inner)] = part[inner]
    return space


def closing_reach() -> int:
    """Voxels as far as a closing reaches."""
    return 2 * (int(np.ceil(CLOSING)) + 1)


def _closed(inside: Bools, radius: float) -> Bools:
    """Morphological closing by a ball, in voxels; what lies beyond the array continues its faces."""
    n = int(np.ceil(radius)) + 1
    padded = np.pad(inside, n, mode="edge")
    grown = edt.edt((~padded).astype(np.uint8), parallel=1) <= radius
    shrunk = edt.edt(grown.astype(np.uint8), parallel=1) > radius
    return np.asarray(shrunk[n:-n, n:-n, n:-n])
