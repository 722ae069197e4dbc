"""The rays of one column of an upright panel, whose columns of pixels are parallel to z.

All rays of a column lie in one vertical plane.  They cross a plane of their dominant horizontal axis a at one place of
the other horizontal axis b, and at heights that grow evenly with the row.  Lengths are in voxels, counted from voxel
[0, 0, 0]; rows are counted from the lowest one, whichever way the panel lies.
"""

from __future__ import annotations

import math

import numba as nb
import numpy as np

from grainmotion.kernels.compilation import CACHE

_jit = nb.njit(cache=CACHE, error_model="numpy")


@_jit
def column_rays(view, cone, column, rows, origin, h):
    """A column's rays: whether a is x, where they start (a b z), and their direction (a b z).

    ``h`` is 1 / voxel size, and the last number returned is what the row above adds to the direction's z; in a
    parallel beam, to the start's.
    """
    row = (1 - rows) / 2 if view[11] >= 0 else (rows - 1) / 2
    sx = (view[3] + column * view[6] + row * view[9] - origin[0]) * h
    sy = (view[4] + column * view[7] + row * view[10] - origin[1]) * h
    sz = (view[5] + column * view[8] + row * view[11] - origin[2]) * h
    dx, dy, dz = view[0], view[1], view[2]
    if cone:
        px, py, pz = sx, sy, sz
        sx, sy, sz = (dx - origin[0]) * h, (dy - origin[1]) * h, (dz - origin[2]) * h
        dx, dy, dz = px - sx, py - sy, pz - sz
    vz = abs(view[11]) * h
    if abs(dx) >= abs(dy):
        return True, sx, sy, sz, dx, dy, dz, vz
    return False, sy, sx, sz, dy, dx, dz, vz


@_jit
def heights(rays, cone, a):
    """z of the lowest ray at a place of axis a, and what each row above adds."""
    _, sa, _, sz, da, _, dz, vz = rays
    t = (a - sa) / da
    return sz + t * dz, t * vz if cone else vz


@_jit
def crossed_planes(rays, na, n_b, radius, margin):
    """The planes first … end − 1 of a, and ``margin`` beside them, on which rays are in the image and its cylinder."""
    _, sa, sb, _, da, db, _, _ = rays
    slope = db / da
    low, high, edge = 1.0, na - 2.0, 1e-3
    if slope != 0.0:
        k0, k1 = sa + (edge - sb) / slope, sa + (n_b - 1 - edge - sb) / slope
        low, high = max(low, min(k0, k1) + margin), min(high, max(k0, k1) - margin)
    elif sb < edge or sb > n_b - 1 - edge:
        return 0, 0
    if radius > 0:
        a, b, reach = sa - (na - 1) / 2, sb - (n_b - 1) / 2, radius + 1.5
        square, half = 1 + slope * slope, a + slope * b
        root = half * half - square * (a * a + b * b - reach * reach)
        if root <= 0:
            return 0, 0
        root = math.sqrt(root)
        low, high = max(low, sa + (-half - root) / square), min(high, sa + (-half + root) / square)
    first = math.ceil(low)
    return first, max(first, math.floor(high) + 1)


@_jit
def columns_across(view, cone, columns, origin, h, rectangle):
    """The columns first … end − 1 of a panel whose rays may use voxels of a rectangle x0, x1, y0, y1."""
    x0, x1, y0, y1 = rectangle
    px, py = (view[3] - origin[0]) * h, (view[4] - origin[1]) * h
    ux, uy, dx, dy = view[6] * h, view[7] * h, view[0], view[1]
    low, high, right = np.inf, -np.inf, 0
    for x in (x0 - 2.0, x1 + 1.0):
        for y in (y0 - 2.0, y1 + 1.0):
            if cone:
                sx, sy = (view[0] - origin[0]) * h, (view[1] - origin[1]) * h
                dx, dy = x - sx, y - sy
                place = (sx - px) * dy - (sy - py) * dx
            else:
                place = (x - px) * dy - (y - py) * dx
            across = ux * dy - uy * dx
            right += across > 0
            low, high = min(low, place / across), max(high, place / across)
    if right % 4 != 0:  # the source is beside the rectangle
        return 0, columns
    middle = (columns - 1) / 2
    first = int(max(0.0, math.ceil(low + middle)))
    return first, max(first, int(min(float(columns), math.floor(high + middle) + 1)))


@_jit
def lengths(rays, cone, voxel, first, out):
    """Lengths of rays between two planes of a, mm, from row ``first`` on."""
    _, _, _, _, da, db, dz, vz = rays
    square = 1.0 + (db / da) ** 2
    for r in range(len(out)):
        rise = (dz + (first + r) * vz if cone else dz) / da
        out[r] = voxel * math.sqrt(square + rise * rise)


@_jit
def axes(rays, tile, shape, radius, margin):
    """How a column's rays cross a tile x0, x1, y0, y1 of an image ``(ny, nx, nz)``.

    Returns the planes first … end − 1 of a in it (see `crossed_planes`), its range b0, b1 of b, and the strides of a
    and b.
    """
    ny, nx, nz = shape
    x0, x1, y0, y1 = tile
    if rays[0]:
        first, end = crossed_planes(rays, nx, ny, radius, margin)
        return max(first, x0), min(end, x1), y0, y1, nz, nx * nz
    first, end = crossed_planes(rays, ny, nx, radius, margin)
    return max(first, y0), min(end, y1), x0, x1, nx * nz, nz


@_jit
def reach(start, step, rows, low, high):
    """The voxels of low … high − 1 that rays at heights start + r · step sample."""
    last = start + (rows - 1) * step
    return max(low, math.floor(min(start, last))), min(high, math.floor(max(start, last)) + 2)
