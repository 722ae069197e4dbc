"""Voxels of a grain that reach furthest in some directions, from where each of its lines begins and ends."""

from __future__ import annotations

import numba as nb
import numpy as np

from grainmotion.kernels.compilation import CACHE


@nb.njit(cache=CACHE, error_model="numpy")
def outermost(firsts, ends, rows, directions, least, furthest, points):
    """Of each of ``directions (k, 3)`` (x y z), how far voxels reach backwards and forwards, and which reach furthest.

    Voxels ``firsts[q]`` to ``ends[q] - 1`` along x of line q, with ``rows`` lines in each layer z, count.
    ``least (k,)`` and ``furthest (k,)`` are the ends of their places along each direction, ``points (k, 3)`` are the
    indices (x y z) of the first voxel of all that reaches furthest.  Returns whether there is any voxel.
    """
    least[:], furthest[:] = np.inf, -np.inf
    found = False
    for q in range(len(firsts)):
        if ends[q] <= firsts[q]:
            continue
        found = True
        first, last, y, z = float(firsts[q]), float(ends[q]) - 1.0, float(q % rows), float(q // rows)
        for k in range(len(directions)):
            dx, across = directions[k, 0], directions[k, 1] * y + directions[k, 2] * z
            near, far = (first, last) if dx > 0 else (last, first)
            least[k] = min(least[k], dx * near + across)
            if dx * far + across > furthest[k]:
                furthest[k] = dx * far + across
                points[k, 0], points[k, 1], points[k, 2] = far, y, z
    return found
