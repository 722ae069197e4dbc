"""Partition: which attenuation belongs to which grain, to a fraction of a voxel.

The reference's voxels blur a surface, and a boundary drawn along them between touching grains is wrong by half a
voxel.  So each grain is resampled on finer voxels by a cubic spline, and what lies between grains is flooded from
their insides in the order of attenuation (a marker watershed), which ends in the valley between two surfaces.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from edt import edt
from numpy.typing import NDArray
from scipy import ndimage
from skimage.segmentation import expand_labels, watershed

from grainmotion.model.volume import Volume

CERTAIN = 1.0
"""Voxels inside a label's edge from which a voxel is surely the grain's."""
CORE = 0.7
"""Share of a grain's largest depth that is sure however thin the grain is."""
SMOOTH = 0.35
"""Width of the filter under which attenuation is flooded, voxels: noise makes no valleys."""
MARGIN = 4
"""Voxels around what is flooded, within which a spline forgets the crop's edge."""

Box = tuple[slice, slice, slice]
Boxed = tuple[int, tuple[slice, ...]]
"""A label, and the box in which it is."""
Fine = tuple[NDArray[np.floating], tuple[int, int, int]]


def fine_grains(
    volume: Volume, labels: NDArray[np.integer], wanted: list[Boxed], factor: int, reach: float
) -> Iterator[Volume | None]:
    """Some grains on voxels ``factor`` times finer, one after the other.

    Parameters
    ----------
    volume : Volume
        Attenuation, 1/mm.
    labels : (nz, ny, nx) int array
        Grains; 0 is none.
    wanted : list of (int, slices)
        Labels of the grains, and the box in which each label is.
    factor : int
    reach : float
        How far beyond labels attenuation is handed to grains, voxels.

    Yields
    ------
    Volume or None
        Cropped to the grain's own voxels, others zero; None if it has none.
    """
    for label, box in wanted:
        around = surroundings(box, volume.shape, reach)
        found = fine_cut(volume.array[around], np.ascontiguousarray(labels[around]), label, factor, reach)
        yield None if found is None else placed(found, volume, around, factor)


def surroundings(box: tuple[slice, ...], shape: tuple[int, ...], reach: float) -> Box:
    """What of a volume decides about the grain in a box."""
    by = int(np.ceil(reach)) + MARGIN
    a, b, c = (slice(max(s.start - by, 0), min(s.stop + by, n)) for s, n in zip(box, shape, strict=True))
    return a, b, c


def fine_cut(
    array: NDArray[np.floating], labels: NDArray[np.integer], label: int, factor: int, reach: float
) -> Fine | None:
    """A grain's finer voxels from its surroundings, and where in these the first is; None if it has none."""
    fine = splined(array, factor)
    mine = flooded(fine, labels, factor, reach) == label
    if not mine.any():
        return None
    inner = ndimage.find_objects(mine.astype(np.int8))[0]
    z, y, x = (int(s.start) for s in inner)
    return np.where(mine[inner], fine[inner], 0), (z, y, x)


def placed(found: Fine, volume: Volume, around: Box, factor: int) -> Volume:
    """Finer voxels in their place."""
    array, inner = found
    h = volume.voxel_size / factor
    starts = [factor * a.start + b for a, b in zip(around, inner, strict=True)]
    first = volume.origin - volume.voxel_size / 2 + h * (np.array(starts[::-1]) + 0.5)
    x, y, z = first + h * (np.array(array.shape[::-1]) - 1) / 2
    return Volume(array, h, (float(x), float(y), float(z)))


def splined(array: NDArray[np.floating], factor: int) -> NDArray[np.floating]:
    """The cubic spline through an array, sampled ``factor`` times as finely along every axis; edges are mirrored."""
    out = array
    for axis in range(array.ndim):
        coefficients = ndimage.spline_filter1d(out, 3, axis=axis, output=array.dtype, mode="reflect")
        finer = np.empty([factor * n if k == axis else n for k, n in enumerate(out.shape)], array.dtype)
        for phase in range(factor):
            place = (phase + 0.5) / factor - 0.5
            weights = _cubic(np.arange(-2, 3) - place)
            view = finer[(slice(None),) * axis + (slice(phase, None, factor),)]
            ndimage.correlate1d(coefficients, weights, axis=axis, output=view, mode="reflect")
        out = finer
    return out


def flooded(fine: NDArray[np.floating], coarse: NDArray[np.integer], factor: int, reach: float) -> NDArray[np.integer]:
    """Labels of fine voxels to ``reach`` coarse ones beyond the labels, parted where two grains are near."""
    grown = expand_labels(coarse, distance=reach) if reach > 0 else coarse
    near = np.kron(grown, np.ones((factor,) * 3, grown.dtype))
    contested = _contested(grown, int(np.ceil(reach)) + 1)
    if not contested.any():
        return near
    here = np.kron(contested, np.ones((factor,) * 3, bool))
    labels = np.where(here, np.kron(coarse, np.ones((factor,) * 3, coarse.dtype)), near)
    depth = edt(labels.astype(np.uint32), black_border=False)
    sure = np.where(here & (depth <= CERTAIN * factor), 0, labels)
    for label in np.setdiff1d(coarse, sure):  # too thin to be sure anywhere
        own = labels == label
        sure[own & (depth >= CORE * depth[own].max())] = label
    # what is settled beyond the contested part matters no further than its rim
    around = ndimage.binary_dilation(here, iterations=1) & (near > 0)
    smooth = ndimage.gaussian_filter(fine, SMOOTH * factor)
    parted = watershed(-smooth, np.where(around, sure, 0), mask=around)
    found: NDArray[np.integer] = np.where(here & (near > 0), parted, near)
    return found


def _contested(grown: NDArray[np.integer], reach: int) -> NDArray[np.bool_]:
    """Voxels with two different labels within ``reach`` voxels along every axis."""
    size = 2 * reach + 1
    top = ndimage.maximum_filter(grown, size)
    most = int(grown.max(initial=0)) + 1
    bottom = ndimage.minimum_filter(np.where(grown > 0, grown, most), size)
    return (bottom < top) & (grown > 0)


def _cubic(x: NDArray[np.floating]) -> NDArray[np.float64]:
    """The cubic B-spline."""
    a = np.abs(x)
    near, far = 2 / 3 - a**2 + a**3 / 2, np.maximum(2 - a, 0) ** 3 / 6
    return np.where(a < 1, near, far)
