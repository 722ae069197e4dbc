"""Whole volumes seen by upright panels: forward projection and its exact adjoint, column of pixels by column.

Where a panel's columns are parallel to z, all rays of a column cross a plane of the dominant axis a at one
place of the other horizontal axis b, and at heights that grow evenly with the row.  The trilinear sample of
`ray_tracing.smooth_value` then parts in two: the two lines of voxels along z beside that place are blended once for the
whole column, and each ray interpolates along the blended line.  That is half the loads of the general projector, and
neighbouring rays find them in the nearest cache: forward takes half of its time, the adjoint a quarter.

The image is ``(ny, nx, nz)``, z fastest, and zero on its two outermost layers; ``origin`` is the position of voxel
[0, 0, 0] (x y z, mm), ``radius`` (voxels) that of the upright cylinder beyond which the image is zero, 0 for none.
The adjoint leaves the outermost layers, and voxels beyond the cylinder, undefined.  Its threads share the planes of
the dominant axis, so that no two write the same voxel and the sums come in one order whatever their number.
"""

from __future__ import annotations

import math

import numba as nb
import numpy as np

from grainmotion.kernels.compilation import CACHE

PLANE_SLICES = 8  # slices of the dominant axis that the adjoint hands to threads
COLUMNS_OF_A_THREAD = 16  # columns that a thread takes in turn, in the same memory
ROWS_AT_ONCE = 512  # rows that the forward projection takes at once: their blended lines stay in the second cache


@nb.njit(cache=CACHE, error_model="numpy")
def _column_ray(view, cone, column, rows, origin, h):
    """Where a column's rays start and their directions to its first row, voxels; z of the next row's adds v_z."""
    row = -(rows - 1) / 2
    px = (view[3] + column * view[6] + row * view[9] - origin[0]) * h
    py = (view[4] + column * view[7] + row * view[10] - origin[1]) * h
    pz = (view[5] + column * view[8] + row * view[11] - origin[2]) * h
    if cone:
        sx, sy, sz = (view[0] - origin[0]) * h, (view[1] - origin[1]) * h, (view[2] - origin[2]) * h
        return sx, sy, sz, px - sx, py - sy, pz - sz
    return px, py, pz, view[0], view[1], view[2]


@nb.njit(cache=CACHE, error_model="numpy")
def _planes(sa, sb, slope, na, n_b, radius):
    """The planes first … end − 1 of a on which the column lies inside the image, and inside its cylinder."""
    low, high, edge = 1.0, na - 2.0, 1e-3
    if slope != 0.0:
        k0, k1 = sa + (edge - sb) / slope, sa + (n_b - 1 - edge - sb) / slope
        low, high = max(low, min(k0, k1)), min(high, max(k0, k1))
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


@nb.njit(cache=CACHE, error_model="numpy")
def _length(voxel, slope, dz, da):
    """Length of a ray between two planes, mm."""
    return voxel * math.sqrt(1.0 + slope * slope + (dz / da) ** 2)


@nb.njit(cache=CACHE, fastmath=True, error_model="numpy")
def _blend(line, near, far, weight):
    for z in range(len(line)):
        line[z] = near[z] + weight * (far[z] - near[z])


@nb.njit(cache=CACHE, fastmath=True, error_model="numpy")
def _spread_line(line, near, far, weight):
    """The adjoint of `_blend`."""
    for z in range(len(line)):
        part = weight * line[z]
        near[z] += line[z] - part
        far[z] += part


@nb.njit(cache=CACHE, fastmath=True, error_model="numpy")
def _line_integral(lines, width, starts, steps, row):
    """Sum over planes k of lines k at height starts[k] + row · steps[k]."""
    f = lines.dtype.type
    top = f(width - 1) * f(1 - 2.5e-7)  # rounds to less than the last voxel
    total = f(0)
    for k in range(np.uint32(len(starts))):
        z = min(max(starts[k] + f(row) * steps[k], f(0)), top)
        i = np.uint32(np.int32(z))
        at = np.uint32(k) * np.uint32(width) + i
        below = lines[at]
        total += below + (z - f(np.int32(i))) * (lines[at + np.uint32(1)] - below)
    return total


@nb.njit(cache=CACHE, error_model="numpy")
def _scatter(lines, width, starts, steps, row, value):
    """The adjoint of `_line_integral`."""
    f = lines.dtype.type
    top = f(width - 1) * f(1 - 2.5e-7)
    for k in range(np.uint32(len(starts))):
        z = min(max(starts[k] + f(row) * steps[k], f(0)), top)
        i = np.uint32(np.int32(z))
        at = np.uint32(k) * np.uint32(width) + i
        above = value * (z - f(np.int32(i)))
        lines[at] += value - above
        lines[at + np.uint32(1)] += above


@nb.njit(parallel=True, cache=CACHE, error_model="numpy")
def forward(image, origin, voxel, views, cone, radius, out):
    """Line integrals ``out (views, rows, columns)`` of ``image``."""
    ny, nx, nz = image.shape
    n, rows, columns = out.shape
    f = image.dtype.type
    h = 1.0 / voxel
    jobs = n * columns
    for block in nb.prange((jobs + COLUMNS_OF_A_THREAD - 1) // COLUMNS_OF_A_THREAD):
        buffer = np.empty(max(nx, ny) * nz, image.dtype)
        all_starts, all_steps = np.empty(max(nx, ny), image.dtype), np.empty(max(nx, ny), image.dtype)
        for job in range(block * COLUMNS_OF_A_THREAD, min(jobs, (block + 1) * COLUMNS_OF_A_THREAD)):
            i, c = job // columns, job % columns
            sx, sy, sz, dx, dy, dz = _column_ray(views[i], cone, c - (columns - 1) / 2, rows, origin, h)
            vz = views[i, 11] * h
            along_x = abs(dx) >= abs(dy)
            sa, sb, da, db, na, n_b = (sx, sy, dx, dy, nx, ny) if along_x else (sy, sx, dy, dx, ny, nx)
            slope = db / da
            first, end = _planes(sa, sb, slope, na, n_b, radius)
            count = end - first
            starts, steps = all_starts[:count], all_steps[:count]
            for r0 in range(0, rows, ROWS_AT_ONCE):
                r1 = min(rows, r0 + ROWS_AT_ONCE)
                lowest, highest = np.inf, -np.inf  # heights of the tile's rays, which are extreme on its last planes
                for k in (first, end - 1):
                    t = (k - sa) / da
                    for r in (r0, r1 - 1):
                        z = sz + t * dz + r * (t * vz if cone else vz)
                        lowest, highest = min(lowest, z), max(highest, z)
                base, over = max(0, math.floor(lowest)), min(nz, math.floor(highest) + 2)
                width = over - base
                if count <= 0 or width < 2:
                    out[i, r0:r1, c] = 0
                    continue
                lines = buffer[: count * width]
                for k in range(first, end):
                    b, t = sb + (k - sa) * slope, (k - sa) / da
                    at = int(b)
                    steps[k - first] = t * vz if cone else vz
                    starts[k - first] = sz + t * dz - base
                    line = lines[(k - first) * width : (k - first + 1) * width]
                    if along_x:
                        _blend(line, image[at, k, base:over], image[at + 1, k, base:over], f(b - at))
                    else:
                        _blend(line, image[k, at, base:over], image[k, at + 1, base:over], f(b - at))
                for r in range(r0, r1):
                    total = _line_integral(lines, width, starts, steps, r)
                    out[i, r, c] = total * f(_length(voxel, slope, dz + r * vz if cone else dz, da))


@nb.njit(parallel=True, cache=CACHE, error_model="numpy")
def adjoint(images, origin, voxel, views, cone, radius, out):
    """Add the exact adjoint of `forward` applied to ``images`` to ``out (ny, nx, nz)``."""
    ny, nx, nz = out.shape
    n, rows, columns = images.shape
    f = out.dtype.type
    h = 1.0 / voxel
    for axis in range(2):
        na, n_b = (nx, ny) if axis == 0 else (ny, nx)
        size = (na + PLANE_SLICES - 1) // PLANE_SLICES
        for chunk in nb.prange(PLANE_SLICES):
            low, high = chunk * size, min(na, (chunk + 1) * size)
            buffer = np.empty(size * nz, out.dtype)
            starts, steps = np.empty(size, out.dtype), np.empty(size, out.dtype)
            for job in range(n * columns):
                i, c = job // columns, job % columns
                sx, sy, sz, dx, dy, dz = _column_ray(views[i], cone, c - (columns - 1) / 2, rows, origin, h)
                if (abs(dx) >= abs(dy)) != (axis == 0):
                    continue
                vz = views[i, 11] * h
                sa, sb, da, db = (sx, sy, dx, dy) if axis == 0 else (sy, sx, dy, dx)
                slope = db / da
                first, end = _planes(sa, sb, slope, na, n_b, radius)
                first, end = max(first, low), min(end, high)
                count = end - first
                if count <= 0:
                    continue
                for k in range(first, end):
                    t = (k - sa) / da
                    starts[k - first] = sz + t * dz
                    steps[k - first] = t * vz if cone else vz
                lines = buffer[: count * nz]
                lines[:] = 0
                for r in range(rows):
                    if images[i, r, c] != 0:
                        value = images[i, r, c] * _length(voxel, slope, dz + r * vz if cone else dz, da)
                        _scatter(lines, nz, starts[:count], steps[:count], r, f(value))
                for k in range(first, end):
                    b = sb + (k - sa) * slope
                    at = int(b)
                    line = lines[(k - first) * nz : (k - first + 1) * nz]
                    if axis == 0:
                        _spread_line(line, out[at, k], out[at + 1, k], f(b - at))
                    else:
                        _spread_line(line, out[k, at], out[k, at + 1], f(b - at))
