"""SART beside the projections: the normalised residual of every ray, and the constraints on every voxel."""

from __future__ import annotations

import math

import numba as nb
import numpy as np

from grainmotion.kernels.compilation import CACHE
from grainmotion.kernels.ray_tracing import clip_range, pixel_ray


@nb.njit(cache=CACHE, error_model="numpy")
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
            low, high = max(low, (-b - math.sqrt(root)) / a), min(high, (-b + math.sqrt(root)) / a)
    return max(0.0, high - low)


@nb.njit(parallel=True, cache=CACHE, error_model="numpy")
def compare(images, measured, valid, origin, voxel, size, radius, views, cone, first, height, squares):
    """(b − A x)/(A 1) in place of A x in ``images (views, rows, columns)``, rows ``first …`` of panels of ``height``.

    ``size`` is the image's (nz, ny, nx), ``squares (views · rows, 2)`` get Σ(b − A x)² and Σb² of each row.
    A 1, the row sums, are the rays' lengths inside the field of view, at least 4 voxels so that rays
    that graze it get no large weight.
    """
    nz, ny, nx = size
    n, rows, columns = images.shape
    h = 1.0 / voxel
    for job in nb.prange(n * rows):
        i, r = job // rows, job % rows
        misfit, norm = 0.0, 0.0
        for c in range(columns):
            px, py, pz, dx, dy, dz = pixel_ray(views[i], cone, first + r - (height - 1) / 2, c - (columns - 1) / 2)
            ox, oy, oz = (px - origin[0]) * h, (py - origin[1]) * h, (pz - origin[2]) * h
            length = chord(ox, oy, oz, dx * h, dy * h, dz * h, nx, ny, nz, radius)
            if length == 0.0 or not valid[i, r, c]:
                images[i, r, c] = 0
                continue
            difference = measured[i, r, c] - images[i, r, c]
            misfit += difference * difference
            norm += measured[i, r, c] * measured[i, r, c]
            images[i, r, c] = difference / max(length, 4 * voxel)
        squares[job, 0] = misfit
        squares[job, 1] = norm


@nb.njit(cache=CACHE, error_model="numpy")
def _inside(x, y, nx, ny, padding, radius):
    """Whether a line of voxels along z lies within the padding and the upright cylinder (if ``radius`` > 0)."""
    if min(x, y) < padding or max(x - nx, y - ny) >= -padding:
        return False
    dx, dy = x - (nx - 1) / 2, y - (ny - 1) / 2
    return radius == 0 or dx * dx + dy * dy <= radius * radius


@nb.njit(parallel=True, cache=CACHE, error_model="numpy")
def constrain(image, padding, radius, lowest):
    """Zero the padding and what lies beyond the cylinder of ``image [y, x, z]``; raise the rest to ``lowest``."""
    ny, nx, nz = image.shape
    for y in nb.prange(ny):
        for x in range(nx):
            line = image[y, x]
            if not _inside(x, y, nx, ny, padding, radius):
                line[:] = 0
                continue
            line[:padding] = 0
            line[nz - padding :] = 0
            for z in range(padding, nz - padding):
                line[z] = max(line[z], lowest)


@nb.njit(parallel=True, cache=CACHE, error_model="numpy")
def constrain_and_extrapolate(image, before, padding, radius, lowest, momentum):
    """`constrain` an image x, then go on: x + momentum · (x − before), with x left in ``before``."""
    ny, nx, nz = image.shape
    for y in nb.prange(ny):
        for x in range(nx):
            line, old = image[y, x], before[y, x]
            if not _inside(x, y, nx, ny, padding, radius):
                line[:] = 0
                continue
            line[:padding] = 0
            line[nz - padding :] = 0
            for z in range(padding, nz - padding):
                value = max(line[z], lowest)
                line[z] = value + momentum * (value - old[z])
                old[z] = value
