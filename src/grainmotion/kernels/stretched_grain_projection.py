"""Projection of grains that are stretched before they rotate, with derivatives by the motion and by the strain.

A grain carries X to x = Ω U (X − c) + c + u, with a rotation Ω and a symmetric stretch U = I + e in the frame of the
reference.  Its mass is conserved: μ(x) = μ(X) / det U.  A ray y + t s of the sample frame, seen from the moved centre,
is o = Ωᵀ y, d = Ωᵀ s in the rotated frame, and o′ = U⁻¹ o, d′ = U⁻¹ d in the grain's own voxels.  There J(o′, d′) is
∫ μ dt, and its gradients are carried to the rotated frame, G = U⁻¹ ∂J/∂o′ and H = U⁻¹ ∂J/∂d′:

    I = |d| J / det U,
    ∂I/∂u = −|d|/det U · Ω G,      ∂I/∂δ = −|d|/det U · Ω (o × G + d × H),
    dI = −|d|/det U · (G · dU o′ + H · dU d′) − I tr(U⁻¹ dU),

the last for a change dU of the stretch.  Strains are ordered xx, yy, zz, yz, xz, xy, and a shear component changes both
entries of U.  Tables are those of `kernels.layout`; what is rigid is in `grain_projection`.
"""

from __future__ import annotations

import numba as nb
import numpy as np

from grainmotion.kernels import grain_ray_packets
from grainmotion.kernels.compilation import CACHE
from grainmotion.kernels.grain_projection import (
    at_columns,
    by_motion,
    lengths,
    product,
    span_of_columns,
    span_of_row,
    store_vectors,
)
from grainmotion.kernels.grain_ray_packets import PACKET_SIZE
from grainmotion.kernels.grain_ray_tracing import row_of_rays
from grainmotion.kernels.vector_functions import counted
from grainmotion.kernels.vector_memory import stored_first

_inlined = nb.njit(cache=CACHE, error_model="numpy", forceinline=True)
_NO_CORNER = np.zeros(3)


@_inlined
def _at_columns(rays, x):
    """o and d of the rays of columns x."""
    return at_columns(rays[0], rays[1], x), at_columns(rays[2], rays[3], x)


@_inlined
def _row(grains, views, extents, g, i, r, c0, c1):
    """Rays of columns c0 … c1 of a row: in the rotated frame, in the grain's voxels, and where they lie in its extents.

    Lengths are voxels.  The rotated frame has its origin at the grain's centre, voxels theirs at voxel [0, 0, 0].
    """
    h, panel = 1.0 / grains.voxel_size, views.panel
    inverse = np.linalg.inv(grains.stretches[g])
    row = r - (panel[0] - 1) / 2
    outer = row_of_rays(views.vectors[i], views.cone, row, grains.positions[g], grains.rotations[g], _NO_CORNER, h)
    o0, corner = product(inverse, outer[0]), grains.corners[g]
    o0 = (o0[0] - corner[0] * h, o0[1] - corner[1] * h, o0[2] - corner[2] * h)
    inner = (o0, product(inverse, outer[1]), product(inverse, outer[2]), product(inverse, outer[3]))
    span = span_of_row(extents, inner, c0 - (panel[1] - 1) / 2, c1 - c0)
    return outer, inner, span, inverse


@nb.njit(parallel=True, cache=CACHE, error_model="numpy")
def project(grains, views, patches, exact, values):
    """Line integrals of every patch."""
    boxes, offsets, jobs = patches.boxes, patches.offsets, patches.lines
    middle = (views.panel[1] - 1) / 2
    for j in nb.prange(len(jobs)):
        p, r, c0, c1 = jobs[j, 0], jobs[j, 1], jobs[j, 2], jobs[j, 3]
        g, i, shape = boxes[p, 0], boxes[p, 1], grains.shapes[boxes[p, 0]]
        image = grains.voxels[grains.starts[g] : grains.starts[g] + shape[0] * shape[1] * shape[2]]
        outer, inner, span, inverse = _row(grains, views, grains.extents[g], g, i, r, c0, c1)
        density = np.linalg.det(inverse)
        at = offsets[p] + (r - boxes[p, 2]) * (boxes[p, 5] - boxes[p, 4]) - boxes[p, 4]
        for c in range(c0, c1, PACKET_SIZE):
            count = min(c1 - c, PACKET_SIZE)
            low, high = span_of_columns(span, c - c0, count)
            x = counted(c - middle, PACKET_SIZE)
            (o, d), (_, b) = _at_columns(inner, x), _at_columns(outer, x)
            total = grain_ray_packets.values(image, shape, o, d, low, high, exact)
            stored_first(values, at + c, density * grains.voxel_size * lengths(b) * total, count)


@nb.njit(parallel=True, cache=CACHE, error_model="numpy")
def project_with_derivatives(grains, views, patches, exact, values, derivatives, by_strain):
    """Line integrals, their ``derivatives (6, pixels)`` by u (mm) and δ (radians), and ``by_strain (6, pixels)``."""
    boxes, offsets, jobs = patches.boxes, patches.offsets, patches.lines
    middle, h = (views.panel[1] - 1) / 2, 1.0 / grains.voxel_size
    for j in nb.prange(len(jobs)):
        p, r, c0, c1 = jobs[j, 0], jobs[j, 1], jobs[j, 2], jobs[j, 3]
        g, i, shape = boxes[p, 0], boxes[p, 1], grains.shapes[boxes[p, 0]]
        image = grains.voxels[grains.starts[g] : grains.starts[g] + shape[0] * shape[1] * shape[2]]
        outer, inner, span, inverse = _row(grains, views, grains.extents[g], g, i, r, c0, c1)
        density, m, corner = np.linalg.det(inverse), grains.rotations[g], grains.corners[g]
        at = offsets[p] + (r - boxes[p, 2]) * (boxes[p, 5] - boxes[p, 4]) - boxes[p, 4]
        for c in range(c0, c1, PACKET_SIZE):
            count = min(c1 - c, PACKET_SIZE)
            low, high = span_of_columns(span, c - c0, count)
            x = counted(c - middle, PACKET_SIZE)
            (o, d), (a, b) = _at_columns(inner, x), _at_columns(outer, x)
            total, g_own, h_own = grain_ray_packets.gradients(image, shape, o, d, low, high, exact)
            length = density * grains.voxel_size * lengths(b)
            q = (o[0] + corner[0] * h, o[1] + corner[1] * h, o[2] + corner[2] * h)
            f, w = product(inverse, g_own), product(inverse, h_own)
            by_shift, by_rotation = by_motion(a, b, f, w, m, -length)
            stored_first(values, at + c, length * total, count)
            store_vectors(derivatives, 0, at + c, count, (h * by_shift[0], h * by_shift[1], h * by_shift[2]))
            store_vectors(derivatives, 3, at + c, count, by_rotation)
            for n in range(3):
                s, t = (n + 1) % 3, (n + 2) % 3
                along = f[n] * q[n] + w[n] * d[n] + total * inverse[n, n]
                shear = f[s] * q[t] + f[t] * q[s] + w[s] * d[t] + w[t] * d[s] + 2 * total * inverse[s, t]
                stored_first(by_strain[n], at + c, -length * along, count)
                stored_first(by_strain[3 + n], at + c, -length * shear, count)
