"""Voxels fainter than others as deep inside their grain: the valley that blur leaves where two grains touch.

Blur closes the gap between two faces that lie close to each other, so that cores join there and the neck is as wide as
the faces.  Some of the gap is still seen: attenuation rises more slowly with depth than below a free surface.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

Floats = NDArray[np.floating]

DEPTH_BIN = 0.5
"""Width of the bins of depth, voxels."""
MAX_DEPTH = 8.0
"""Depth from which attenuation does not depend on it, voxels."""
MAX_LEVEL = 1.05
"""Attenuation over the grain's own, from which a voxel is of an inclusion and counts as this much."""
NOISE_DEPTH = 2.0
"""Depth from which noise is measured, voxels."""
NOISE_WINDOW = 3
"""Edge of the cubes over which deficits are averaged to measure it, voxels."""


def deficits(level: Floats, distance: Floats) -> tuple[Floats, float]:
    """How much fainter voxels are than the median of those as deep.

    Parameters
    ----------
    level : (nz, ny, nx) array
        Attenuation over the grain's own nearby.
    distance : (nz, ny, nx) array
        Depth inside the cores of the grains, voxels; 0 outside.

    Returns
    -------
    deficits : (nz, ny, nx) array
        As a share of the grain's own attenuation; 0 outside of the cores.
    noise : float
        Standard deviation of their mean over a neck of n faces, times the root of n.  It is taken from means over cubes
        as wide as a neck of nine faces, since noise is correlated between voxels.
    """
    inside = distance > 0
    depth, level = distance[inside], np.minimum(level[inside], MAX_LEVEL)
    out = np.zeros(distance.shape, np.float32)
    if not depth.size:
        return out, 0.0
    bins = (np.minimum(depth, MAX_DEPTH) / DEPTH_BIN).astype(np.intp)
    order = np.argsort(bins, kind="stable")
    typical = np.zeros(int(bins.max()) + 1)
    present, starts = np.unique(bins[order], return_index=True)
    for k, values in zip(present, np.split(level[order], starts[1:]), strict=True):
        typical[k] = np.median(values)
    own = typical[bins] - level
    out[inside] = own
    means = ndimage.uniform_filter(out, NOISE_WINDOW)[distance > NOISE_DEPTH]
    noise = 1.4826 * float(np.median(np.abs(means - np.median(means)))) if means.size else 0.0
    return out, NOISE_WINDOW * noise
