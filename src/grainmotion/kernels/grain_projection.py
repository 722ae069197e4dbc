"""Projection of moving grains, one patch of pixels a (grain, view), with derivatives by the six motions.

Rays are pulled back into each grain's own voxels: with y = p − c − u a point of the ray seen from the
moved centre and e its direction, both in the sample frame, the grain's frame has o = Ωᵀ y and d = Ωᵀ e.
With G = ∂I/∂o and H = ∂I/∂d,

    ∂I/∂u = −Ω G,      ∂I/∂δ = −Ω (o × G + d × H)      for  Ω ← exp[δ]ₓ Ω.

Grains, views and patches are tables of `kernels.layout`.  A run of pixels (``patches.lines``) is the unit of parallel
work; pixels of a patch that belong to no run are left as they are.
"""

from __future__ import annotations

import math

import numba as nb
import numpy as np

from grainmotion.kernels.compilation import CACHE
from grainmotion.kernels.grain_ray_tracing import (
    between,
    exact_path,
    exact_value,
    ordered,
    row_of_rays,
    smooth_path,
    smooth_value,
)

_inlined = nb.njit(cache=CACHE, error_model="numpy", forceinline=True)  # calls would cost a tenth of the whole


@_inlined
def value_at(image, shape, o, d, low, high, voxel, exact):
    """I of the ray o + t d through a grain's voxels, t from low to high."""
    _, first, count, oo, dd, strides, sizes = ordered(o, d, shape, low, high)
    length = voxel * math.sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2])
    if exact:
        return length * exact_value(image, first, count, oo, dd, strides, sizes)
    return length * smooth_value(image, first, count, oo, dd, strides, sizes)


@_inlined
def gradients_at(image, shape, o, d, low, high, exact):
    """J of the ray o + t d in a grain's voxels, and its gradients G by o and H by d (see `grain_ray_tracing`)."""
    axis, first, count, oo, dd, strides, sizes = ordered(o, d, shape, low, high)
    if exact:
        total, gb, gc, hb, hc = exact_path(image, first, count, oo, dd, strides, sizes)
    else:
        total, gb, gc, hb, hc = smooth_path(image, first, count, oo, dd, strides, sizes)
    inverse = 1.0 / dd[0]
    ga = -(gb * dd[1] + gc * dd[2]) * inverse
    ha = -(total + hb * dd[1] + hc * dd[2]) * inverse
    if axis == 0:
        gx, gy, gz, hx, hy, hz = ga, gb, gc, ha, hb, hc
    elif axis == 1:
        gx, gy, gz, hx, hy, hz = gb, ga, gc, hb, ha, hc
    else:
        gx, gy, gz, hx, hy, hz = gb, gc, ga, hb, hc, ha
    return total, (gx, gy, gz), (hx, hy, hz)


@_inlined
def derivatives_at(image, shape, corner, o, d, low, high, m, voxel, exact):
    """I of the ray o + t d, and its derivatives by u and δ, for a grain rotated by the matrix m."""
    total, (gx, gy, gz), (hx, hy, hz) = gradients_at(image, shape, o, d, low, high, exact)
    h, length = 1.0 / voxel, voxel * math.sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2])
    ox, oy, oz = o[0] + corner[0] * h, o[1] + corner[1] * h, o[2] + corner[2] * h
    tx = -length * (oy * gz - oz * gy + d[1] * hz - d[2] * hy)
    ty = -length * (oz * gx - ox * gz + d[2] * hx - d[0] * hz)
    tz = -length * (ox * gy - oy * gx + d[0] * hy - d[1] * hx)
    gx, gy, gz = -length * h * gx, -length * h * gy, -length * h * gz
    by_shift = (
        m[0, 0] * gx + m[0, 1] * gy + m[0, 2] * gz,
        m[1, 0] * gx + m[1, 1] * gy + m[1, 2] * gz,
        m[2, 0] * gx + m[2, 1] * gy + m[2, 2] * gz,
    )
    by_rotation = (
        m[0, 0] * tx + m[0, 1] * ty + m[0, 2] * tz,
        m[1, 0] * tx + m[1, 1] * ty + m[1, 2] * tz,
        m[2, 0] * tx + m[2, 1] * ty + m[2, 2] * tz,
    )
    return length * total, by_shift, by_rotation


@nb.njit(parallel=True, cache=CACHE, error_model="numpy")
def project(grains, views, patches, exact, values):
    """Line integrals of every patch."""
    images, starts, shapes, corners, extents, voxel, positions, matrices, _ = grains
    vectors, cone, panel = views
    boxes, offsets, jobs = patches.boxes, patches.offsets, patches.lines
    for j in nb.prange(len(jobs)):
        p, r, c0, c1 = jobs[j, 0], jobs[j, 1], jobs[j, 2], jobs[j, 3]
        g, i = boxes[p, 0], boxes[p, 1]
        image = images[starts[g] : starts[g] + shapes[g, 0] * shapes[g, 1] * shapes[g, 2]]
        middle = (panel[1] - 1) / 2
        row = r - (panel[0] - 1) / 2
        o0, o1, d0, d1 = row_of_rays(vectors[i], cone, row, positions[g], matrices[g], corners[g], 1.0 / voxel)
        span = np.empty((2, c1 - c0), np.float32)
        between(extents[g], o0, o1, d0, d1, c0 - middle, span)
        at = offsets[p] + (r - boxes[p, 2]) * (boxes[p, 5] - boxes[p, 4]) - boxes[p, 4]
        for c in range(c0, c1):
            low, high = span[0, c - c0], span[1, c - c0]
            if low > high:
                values[at + c] = 0
                continue
            x = c - middle
            o = (o0[0] + x * o1[0], o0[1] + x * o1[1], o0[2] + x * o1[2])
            d = (d0[0] + x * d1[0], d0[1] + x * d1[1], d0[2] + x * d1[2])
            values[at + c] = value_at(image, shapes[g], o, d, low, high, voxel, exact)


@nb.njit(parallel=True, cache=CACHE, error_model="numpy")
def project_with_derivatives(grains, views, patches, exact, values, derivatives):
    """Line integrals and their derivatives ``(6, pixels)`` by u (mm) and δ (radians)."""
    images, starts, shapes, corners, extents, voxel, positions, matrices, _ = grains
    vectors, cone, panel = views
    boxes, offsets, jobs = patches.boxes, patches.offsets, patches.lines
    for j in nb.prange(len(jobs)):
        p, r, c0, c1 = jobs[j, 0], jobs[j, 1], jobs[j, 2], jobs[j, 3]
        g, i = boxes[p, 0], boxes[p, 1]
        image = images[starts[g] : starts[g] + shapes[g, 0] * shapes[g, 1] * shapes[g, 2]]
        m = matrices[g]
        middle = (panel[1] - 1) / 2
        row = r - (panel[0] - 1) / 2
        o0, o1, d0, d1 = row_of_rays(vectors[i], cone, row, positions[g], m, corners[g], 1.0 / voxel)
        span = np.empty((2, c1 - c0), np.float32)
        between(extents[g], o0, o1, d0, d1, c0 - middle, span)
        at = offsets[p] + (r - boxes[p, 2]) * (boxes[p, 5] - boxes[p, 4]) - boxes[p, 4]
        for c in range(c0, c1):
            low, high = span[0, c - c0], span[1, c - c0]
            if low > high:
                values[at + c] = 0
                for k in range(6):
                    derivatives[k, at + c] = 0
                continue
            x = c - middle
            o = (o0[0] + x * o1[0], o0[1] + x * o1[1], o0[2] + x * o1[2])
            d = (d0[0] + x * d1[0], d0[1] + x * d1[1], d0[2] + x * d1[2])
            total, by_shift, by_rotation = derivatives_at(
                image, shapes[g], corners[g], o, d, low, high, m, voxel, exact
            )
            values[at + c] = total
            derivatives[0, at + c], derivatives[1, at + c], derivatives[2, at + c] = by_shift
            derivatives[3, at + c], derivatives[4, at + c], derivatives[5, at + c] = by_rotation


@nb.njit(cache=CACHE, error_model="numpy")
def add_patches(values, boxes, offsets, out):
    """Add patches to the radiographs ``out (views, rows, columns)``."""
    for p in range(len(boxes)):
        i, r0, r1, c0, c1 = boxes[p, 1], boxes[p, 2], boxes[p, 3], boxes[p, 4], boxes[p, 5]
        at = offsets[p]
        for r in range(r0, r1):
            for c in range(c0, c1):
                out[i, r, c] += values[at]
                at += 1
