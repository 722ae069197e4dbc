"""Boundaries between grains to a fraction of a voxel.

The reference's voxels blur a surface, and a boundary drawn along them between touching grains is wrong by half a
voxel.  So each grain is upsampled by a cubic spline, and the region between grains is flooded from their insides in
the order of attenuation (a marker-controlled watershed), so that the boundary lies in the valley between two surfaces.
Of the other grains only that they are others is asked, and only near the grain.
"""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import NDArray

from grainmotion.kernels import contested_voxels, spline_upsampling
from grainmotion.model.volume import Volume

MARKER_SHARE = 0.7
"""Share of its largest depth that is a marker in a grain too thin for markers deeper than a voxel inside its edge."""
FLOODING_SIGMA = 0.35
"""Width of the Gaussian filter of the attenuation that is flooded, voxels: noise makes no valleys."""
MAX_BOUNDARY_SHIFT = 3
"""Voxels that a boundary between two labels may lie off, before it is refined."""
SPLINE_MARGIN = 4
"""Voxels around a crop, over which the spline's dependence on the crop's edge decays."""
RANGE_BEYOND = 0.25
"""How far the values of a spline may lie beyond those that it goes through, as a share of their range."""

Box = tuple[slice, slice, slice]
Fine = tuple[NDArray[np.floating], tuple[int, int, int]]
"""Upsampled voxels of a grain, and the index of the first of them in the upsampled crop."""


def surroundings(box: tuple[slice, ...], shape: tuple[int, ...], reach: float) -> Box:
    """The part of a volume on which the upsampled grain in a box depends, once its labels are grown."""
    return widened(box, shape, int(np.ceil(reach)) + SPLINE_MARGIN)


def widened(box: tuple[slice, ...], shape: tuple[int, ...], margin: int) -> Box:
    """A box with a margin, as far as the volume goes."""
    a, b, c = (slice(max(s.start - margin, 0), min(s.stop + margin, n)) for s, n in zip(box, shape, strict=True))
    return a, b, c


def fine_cut(
    array: NDArray[np.floating],
    labels: NDArray[np.integer],
    grown: NDArray[np.integer],
    label: int,
    upsampling: int,
    reach: float,
) -> Fine | None:
    """The upsampled grain in a crop of `surroundings`; None if it has no voxel."""
    coefficients = np.array(array, order="C")
    lowest, highest = float(coefficients.min()), float(coefficients.max())
    spline_upsampling.to_coefficients(coefficients)
    given = np.ascontiguousarray(labels, np.int32), np.ascontiguousarray(grown, np.int32)
    kinds, corner = _kinds(*given, label, upsampling, reach)
    if kinds is None:
        return None
    if (kinds == contested_voxels.WANTING).any():
        weights = _smooth_weights(upsampling).astype(coefficients.dtype)
        sizes = (np.array(kinds.shape) - 2) // upsampling
        smooth = spline_upsampling.sample(coefficients, weights, np.column_stack([corner, corner + sizes]))
        beyond = RANGE_BEYOND * (highest - lowest)
        contested_voxels.flood(kinds, contested_voxels.levels_of(smooth, lowest - beyond, highest + beyond))
    limits = contested_voxels.own_limits(kinds)
    if limits[0, 1] == 0:
        return None
    # whole voxels of the reference around the grain
    whole = np.column_stack([limits[:, 0] // upsampling, -(-limits[:, 1] // upsampling)])
    fine = spline_upsampling.sample(coefficients, _weights(upsampling).astype(array.dtype), whole + corner[:, None])
    inner = tuple(slice(a, b) for a, b in limits - upsampling * whole[:, :1])
    own = np.ascontiguousarray(fine[inner])
    contested_voxels.keep_own(own, kinds[tuple(slice(a + 1, b + 1) for a, b in limits)])
    z, y, x = (int(n) for n in limits[:, 0] + upsampling * corner)
    return own, (z, y, x)


def _kinds(
    labels: NDArray[np.int32], grown: NDArray[np.int32], label: int, upsampling: int, reach: float
) -> tuple[NDArray[np.uint8] | None, NDArray[np.int64]]:
    """What is known of each finer voxel of a part of the crop before flooding, and the first voxel of that part."""
    distance = int(np.ceil(reach)) + 1
    contested = contested_voxels.find_contested(grown, distance)
    known = contested_voxels.known_labels(labels, grown, contested)
    near = contested_voxels.find_near(grown, label, min(distance, MAX_BOUNDARY_SHIFT))
    places = [np.flatnonzero(near.any(axis=axes)) for axes in ((1, 2), (0, 2), (0, 1))]
    if not len(places[0]):
        return None, np.zeros(3, np.int64)
    box = widened(tuple(slice(p[0], p[-1] + 1) for p in places), grown.shape, 1)
    squares = contested_voxels.squared_steps(upsampling)
    least = contested_voxels.sure_depths(known, contested, MARKER_SHARE, squares)
    around = tuple(slice(s.start, s.stop + 2) for s in box)
    kinds = contested_voxels.classes(known[around], grown[box], (contested & near)[box], label, least, squares)
    return kinds, np.array([s.start for s in box])


def placed(grain: Fine, volume: Volume, around: Box, upsampling: int) -> Volume:
    """An upsampled grain in its place in the sample frame; ``around`` is the crop of the volume."""
    array, inner = grain
    voxel_size = volume.voxel_size / upsampling
    starts = [upsampling * a.start + b for a, b in zip(around, inner, strict=True)]
    first = volume.origin - volume.voxel_size / 2 + voxel_size * (np.array(starts[::-1]) + 0.5)
    x, y, z = first + voxel_size * (np.array(array.shape[::-1]) - 1) / 2
    return Volume(array, voxel_size, (float(x), float(y), float(z)))


def upsampled(array: NDArray[np.floating], upsampling: int) -> NDArray[np.floating]:
    """The cubic spline through an array, sampled ``upsampling`` times as finely; edges are mirrored."""
    coefficients = np.array(array, order="C")
    spline_upsampling.to_coefficients(coefficients)
    box = np.array([[0, n] for n in array.shape])
    return spline_upsampling.sample(coefficients, _weights(upsampling).astype(array.dtype), box)


@cache
def _weights(upsampling: int) -> NDArray[np.float64]:
    """Weights of the spline's coefficients at each of the finer voxels of a voxel."""
    places = (np.arange(upsampling) + 0.5) / upsampling - 0.5
    return np.array([_cubic_b_spline(np.arange(-2, 3) - place) for place in places])


@cache
def _smooth_weights(upsampling: int) -> NDArray[np.float64]:
    """The same after the Gaussian filter of `FLOODING_SIGMA`."""
    sigma, weights = FLOODING_SIGMA * upsampling, _weights(upsampling)
    reach = int(4 * sigma + 0.5)
    steps = np.arange(-reach, reach + 1)
    gauss = np.exp(-0.5 * (steps / sigma) ** 2)
    middle = 2 - (-reach // upsampling)
    out = np.zeros((upsampling, 2 * middle + 1))
    for phase in range(upsampling):
        for weight, place in zip(gauss / gauss.sum(), phase + steps, strict=True):
            voxel = middle + place // upsampling
            out[phase, voxel - 2 : voxel + 3] += weight * weights[place % upsampling]
    return out


def _cubic_b_spline(x: NDArray[np.floating]) -> NDArray[np.float64]:
    a = np.abs(x)
    near, far = 2 / 3 - a**2 + a**3 / 2, np.maximum(2 - a, 0) ** 3 / 6
    return np.where(a < 1, near, far)
