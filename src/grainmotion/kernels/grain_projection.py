"""Projection of moving grains, one patch of pixels a (grain, view), with derivatives by the six motions.

Rays are pulled back into each grain's own voxels: with y = p − c − u a point of the ray seen from the
moved centre and e its direction, both in the sample frame, the grain's frame has o = Ωᵀ y and d = Ωᵀ e.
With G = ∂I/∂o and H = ∂I/∂d,

    ∂I/∂u = −Ω G,      ∂I/∂δ = −Ω (o × G + d × H)      for  Ω ← exp[δ]ₓ Ω.

Grains, views and patches are tables of `kernels.layout`.  A run of pixels (``patches.lines``) is the unit of parallel
work; pixels of a patch that belong to no run are left as they are.
"""

from __future__ import annotations

import numba as nb
import numpy as np

from grainmotion.kernels import grain_ray_packets
from grainmotion.kernels.compilation import CACHE
from grainmotion.kernels.grain_ray_packets import PACKET_SIZE
from grainmotion.kernels.grain_ray_tracing import FAR, between, row_of_rays
from grainmotion.kernels.vector_functions import as_double, counted, square_root, where
from grainmotion.kernels.vector_memory import loaded, stored_first

_inlined = nb.njit(cache=CACHE, error_model="numpy", forceinline=True)  # calls would cost a tenth of the whole


@_inlined
def at_columns(start, step, x):
    """start + x step, for the rays of columns x."""
    return start[0] + x * step[0], start[1] + x * step[1], start[2] + x * step[2]


@_inlined
def lengths(d):
    """Lengths of the vectors (x, y, z) of all lanes."""
    return square_root(d[0] * d[0] + d[1] * d[1] + d[2] * d[2])


@_inlined
def span_of_row(extents, rays, start, columns):
    """`between` for the rays (o₀, o₁, d₀, d₁) of a row, with room to read eight from any column."""
    span = np.empty((2, columns + PACKET_SIZE), np.float32)
    between(extents, rays[0], rays[1], rays[2], rays[3], start, span)
    return span


@_inlined
def span_of_columns(span, c, count):
    """Where eight rays, of which ``count`` are traced, lie in a grain's extents: ends of t."""
    low, high = as_double(loaded(span[0], c, PACKET_SIZE)), as_double(loaded(span[1], c, PACKET_SIZE))
    return where(counted(0, PACKET_SIZE) < count, low, FAR), high


@_inlined
def product(m, x):
    """m x."""
    return (
        m[0, 0] * x[0] + m[0, 1] * x[1] + m[0, 2] * x[2],
        m[1, 0] * x[0] + m[1, 1] * x[1] + m[1, 2] * x[2],
        m[2, 0] * x[0] + m[2, 1] * x[1] + m[2, 2] * x[2],
    )


@_inlined
def by_motion(o, d, g, h, m, factor):
    """Derivatives by u and δ, from the gradients by o and by d, of which ``factor`` G and ``factor`` H are to be taken.

    Lengths are voxels; o counts from the grain's centre, which the matrix m rotates.
    """
    f = (factor * g[0], factor * g[1], factor * g[2])
    w = (factor * h[0], factor * h[1], factor * h[2])
    turning = (
        o[1] * f[2] - o[2] * f[1] + d[1] * w[2] - d[2] * w[1],
        o[2] * f[0] - o[0] * f[2] + d[2] * w[0] - d[0] * w[2],
        o[0] * f[1] - o[1] * f[0] + d[0] * w[1] - d[1] * w[0],
    )
    return product(m, f), product(m, turning)


@_inlined
def store_vectors(arrays, first, at, count, by):
    """Put three components of ``count`` lanes into rows ``first`` to ``first + 2``."""
    stored_first(arrays[first], at, by[0], count)
    stored_first(arrays[first + 1], at, by[1], count)
    stored_first(arrays[first + 2], at, by[2], count)


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
        rays = row_of_rays(vectors[i], cone, row, positions[g], matrices[g], corners[g], 1.0 / voxel)
        span = span_of_row(extents[g], rays, c0 - middle, c1 - c0)
        at = offsets[p] + (r - boxes[p, 2]) * (boxes[p, 5] - boxes[p, 4]) - boxes[p, 4]
        for c in range(c0, c1, PACKET_SIZE):
            count = min(c1 - c, PACKET_SIZE)
            low, high = span_of_columns(span, c - c0, count)
            x = counted(c - middle, PACKET_SIZE)
            o, d = at_columns(rays[0], rays[1], x), at_columns(rays[2], rays[3], x)
            total = grain_ray_packets.values(image, shapes[g], o, d, low, high, exact)
            stored_first(values, at + c, voxel * lengths(d) * total, count)


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
        m, h = matrices[g], 1.0 / voxel
        corner = (corners[g, 0] * h, corners[g, 1] * h, corners[g, 2] * h)
        middle = (panel[1] - 1) / 2
        row = r - (panel[0] - 1) / 2
        rays = row_of_rays(vectors[i], cone, row, positions[g], m, corners[g], h)
        span = span_of_row(extents[g], rays, c0 - middle, c1 - c0)
        at = offsets[p] + (r - boxes[p, 2]) * (boxes[p, 5] - boxes[p, 4]) - boxes[p, 4]
        for c in range(c0, c1, PACKET_SIZE):
            count = min(c1 - c, PACKET_SIZE)
            low, high = span_of_columns(span, c - c0, count)
            x = counted(c - middle, PACKET_SIZE)
            o, d = at_columns(rays[0], rays[1], x), at_columns(rays[2], rays[3], x)
            total, g_own, h_own = grain_ray_packets.gradients(image, shapes[g], o, d, low, high, exact)
            length = voxel * lengths(d)
            by_shift, by_rotation = by_motion(
                (o[0] + corner[0], o[1] + corner[1], o[2] + corner[2]), d, g_own, h_own, m, -length
            )
            stored_first(values, at + c, length * total, count)
            store_vectors(derivatives, 0, at + c, count, (by_shift[0] * h, by_shift[1] * h, by_shift[2] * h))
            store_vectors(derivatives, 3, at + c, count, by_rotation)


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
