"""How far a surface must move for the attenuation on its two sides to balance.

A reconstruction that is kept at or above zero has no undershoot outside an edge to go with the overshoot inside, so
that half of the attenuation is reached too far inside: by 0.03 voxel on stones in a simulated scan, 0.9 % of the volume
of a grain of 20 voxels.  Its sum of attenuation is right, for the radiographs measure that.  So the surface is moved to
where the attenuation missing inside is that found outside, as Gibbs places the dividing surface between two phases.

Only a layer about the surface counts, against the attenuation just below it and the haze just above it: neither slow
changes of attenuation across a grain, nor dust or inclusions farther away make a difference.
"""

from __future__ import annotations

import numpy as np
from edt import edt
from numpy.typing import NDArray
from scipy import ndimage
from scipy.spatial import cKDTree

from grainmotion._typing import Float
from grainmotion.grain_shapes.triangle_mesh import Surface
from grainmotion.model.volume import Volume

LAYER, LAYER_IN_BLURS = 1.5, 1.5
"""Half of the layer's thickness, voxels: a constant, and this many standard deviations of the blur more."""
BESIDE_LAYER_INSIDE, BESIDE_LAYER_OUTSIDE = 2.0, 1.0
"""How far beyond the layer the attenuation of the grain and the haze are read, voxels."""
MIN_BESIDE_LAYER = 50
"""Voxels from which they are read; with fewer they are taken as 1 and 0."""
PARTLY_FILLED_DEPTH = 0.75
"""Distance from the surface up to which voxels are partly filled, voxels."""
MAX_EXCESS = 0.2
"""Most by which a voxel that is not partly filled counts more or less than full or empty: inclusions, noise."""
REACH_STEP = 0.25
"""Step in which the reach of the grain's own voxels is looked for, voxels."""
MAX_BALANCING_SHIFT = 0.25
"""Largest shift, voxels: beyond it the balance is upset by something else, and the surface stays."""


def balancing_shift(
    share: Float, inside: NDArray[np.bool_], surface: Surface, normals: Float, grid: Volume, blur: float
) -> float:
    """Distance by which a surface must move outwards, voxels.

    Parameters
    ----------
    share : (nz, ny, nx) array
        Attenuation of the grain's own voxels over that of its inside.
    inside : (nz, ny, nx) bool array
        Voxels above half of that, cavities filled; the largest piece is the surface's.
    surface : Surface
        Of the grain, mm.
    normals : (n, 3) array
        Outward unit normals at its vertices.
    grid : Volume
        Voxel size and place of ``share``.
    blur : float
        Standard deviation of the image's blur, voxels.

    Returns
    -------
    float
        Less than `MAX_BALANCING_SHIFT` either way.
    """
    h, half = grid.voxel_size, LAYER + LAYER_IN_BLURS * blur
    body = _largest_piece(inside)
    heights = _heights(body, surface, normals, grid, half + BESIDE_LAYER_INSIDE)
    body = np.where(np.isfinite(heights), heights < 0, body)
    level = _typical(share[(heights < -half) & (heights > -half - BESIDE_LAYER_INSIDE)], 1.0)
    haze = _typical(share[(heights > half) & (heights < half + BESIDE_LAYER_OUTSIDE) & (share != 0)], 0.0)
    if not level > haze + 0.5:
        return 0.0
    layer = np.abs(heights) < half
    at, full = heights[layer], body[layer]
    scaled = (share[layer] - haze) / (level - haze)
    slack = np.where(np.abs(at) < PARTLY_FILLED_DEPTH, 1.0 + MAX_EXCESS, MAX_EXCESS)
    scaled = np.clip(scaled, np.maximum(full - slack, -MAX_EXCESS), np.minimum(full + slack, 1 + MAX_EXCESS))
    reach = _reach(share[layer] != 0, at, half)
    near = np.abs(at) < reach
    deeper = float((scaled - 1)[at <= -reach].sum())  # a deficit there would be the tail of a blur, cut off outside
    held = np.count_nonzero(body & ~layer) + np.count_nonzero(full & ~near) + float(scaled[near].sum())
    shift = (held + max(deeper, 0.0) - surface.volume / h**3) / (surface.area / h**2)
    return shift if abs(shift) < MAX_BALANCING_SHIFT else 0.0


def _largest_piece(inside: NDArray[np.bool_]) -> NDArray[np.bool_]:
    pieces, count = ndimage.label(inside)
    return inside if count < 2 else pieces == 1 + int(np.bincount(pieces.ravel())[1:].argmax())


def _heights(body: NDArray[np.bool_], surface: Surface, normals: Float, grid: Volume, limit: float) -> Float:
    """Distances of voxel centres to the surface, voxels, negative inside; NaN beyond the limit."""
    apart = np.maximum(edt(body, black_border=False), edt(~body, black_border=False))  # from voxel to voxel
    near = apart < limit + 1
    places = grid.origin + grid.voxel_size * np.argwhere(near)[:, ::-1]
    nearest = cKDTree(surface.vertices).query(places)[1]
    offsets = places - surface.vertices[nearest]
    heights = np.full(grid.shape, np.nan)
    heights[near] = np.einsum("ij,ij->i", offsets, normals[nearest]) / grid.voxel_size
    return heights


def _typical(values: Float, otherwise: float) -> float:
    return float(np.median(values)) if len(values) >= MIN_BESIDE_LAYER else otherwise


def _reach(own: NDArray[np.bool_], heights: Float, limit: float) -> float:
    """Height up to which most voxels hold attenuation of the grain, voxels: labels were grown so far, or it ends."""
    for height in np.arange(0.0, limit, REACH_STEP):
        step = (heights >= height) & (heights < height + REACH_STEP)
        if np.count_nonzero(own[step]) < 0.5 * np.count_nonzero(step):
            return float(height)
    return limit
