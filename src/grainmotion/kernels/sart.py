"""One view of SART: the normalised residual of every ray."""

from __future__ import annotations

import numba as nb
import numpy as np

from grainmotion.kernels.rays import clip_range, enter, exact_value, pixel_ray, smooth_value


@nb.njit(cache=True, error_model="numpy")
def chord(ox, oy, oz, dx, dy, dz, nx, ny, nz, radius):
    """Length in s of a ray inside the image, and inside its upright cylinder of ``radius`` voxels if > 0."""
    low, high = clip_range(ox, dx, nx, -np.inf, np.inf)
    low, high = clip_range(oy, dy, ny, low, high)
    low, high = clip_range(oz, dz, nz, low, high)
    if radius > 0:
        x, y = ox - (nx - 1) / 2, oy - (ny - 1) / 2
        a, b, c = dx * dx + dy * dy, x * dx + y * dy, x * x + y * y - radius * radius
        root = b * b - a * c
        if (root <= 0 and a > 0) or (a == 0 and c > 0):
            return 0.0
        if a > 0:
            low, high = max(low, (-b - np.sqrt(root)) / a), min(high, (-b + np.sqrt(root)) / a)
    return max(0.0, high - low)


@nb.njit(parallel=True, cache=True, error_model="numpy")
def residual(image, origin, voxel, view, cone, exact, radius, measured, valid, out, squares):
    """(b − A x)/A1 of one view in ``out (rows, columns)``; ``squares (rows, 2)`` get Σ(b − Ax)² and Σb² a row.

    A1, the row sums, are the rays' lengths inside the field of view, at least 4 voxels so that rays
    that graze it do not shout.
    """
    nz, ny, nx = image.shape
    flat = image.ravel()
    rows, columns = measured.shape
    h = 1.0 / voxel
    for r in nb.prange(rows):
        misfit, norm = 0.0, 0.0
        for c in range(columns):
            px, py, pz, dx, dy, dz = pixel_ray(view, cone, r - (rows - 1) / 2, c - (columns - 1) / 2)
            ox, oy, oz = (px - origin[0]) * h, (py - origin[1]) * h, (pz - origin[2]) * h
            length = chord(ox, oy, oz, dx * h, dy * h, dz * h, nx, ny, nz, radius)
            if length == 0.0 or not valid[r, c]:
                out[r, c] = 0
                continue
            _, first, count, oa, ob, oc, da, db, dc, sa, sb, sc = enter(
                ox, oy, oz, dx * h, dy * h, dz * h, nx, ny, nz, exact
            )
            value = nb.float64(0)
            if count > 0:
                if exact:
                    value = exact_value(flat, first, count, oa, ob, oc, da, db, dc, sa, sb, sc)
                else:
                    value = smooth_value(flat, first, count, oa, ob, oc, da, db, dc, sa, sb, sc)
            difference = measured[r, c] - value
            misfit += difference * difference
            norm += measured[r, c] * measured[r, c]
            out[r, c] = difference / max(length, 4 * voxel)
        squares[r, 0] = misfit
        squares[r, 1] = norm


@nb.njit(parallel=True, cache=True, error_model="numpy")
def constrain(image, padding, radius, non_negative):
    """Zero the padding and what lies outside the upright cylinder (``radius`` in voxels, if > 0); clip at zero."""
    nz, ny, nx = image.shape
    for z in nb.prange(nz):
        for y in range(ny):
            dy = y - (ny - 1) / 2
            for x in range(nx):
                dx = x - (nx - 1) / 2
                if (
                    min(x, y, z) < padding
                    or max(x - nx, y - ny, z - nz) >= -padding
                    or (radius > 0 and dx * dx + dy * dy > radius * radius)
                    or (non_negative and image[z, y, x] < 0)
                ):
                    image[z, y, x] = 0
