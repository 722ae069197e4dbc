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

import math

import numba as nb
import numpy as np

from grainmotion.kernels.compilation import CACHE
from grainmotion.kernels.grain_projection import gradients_at, value_at
from grainmotion.kernels.grain_ray_tracing import between, row_of_rays

_inlined = nb.njit(cache=CACHE, error_model="numpy", forceinline=True)
_NO_CORNER = np.zeros(3)


@_inlined
def _product(m, x):
    """m x."""
    return (
        m[0, 0] * x[0] + m[0, 1] * x[1] + m[0, 2] * x[2],
        m[1, 0] * x[0] + m[1, 1] * x[1] + m[1, 2] * x[2],
        m[2, 0] * x[0] + m[2, 1] * x[1] + m[2, 2] * x[2],
    )


@_inlined
def _at_column(start, step, c):
    """start + c step."""
    return (start[0] + c * step[0], start[1] + c * step[1], start[2] + c * step[2])


@_inlined
def _scaled(x, factor):
    return (factor * x[0], factor * x[1], factor * x[2])


@_inlined
def _length(d):
    return math.sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2])


@_inlined
def _row(grains, views, extents, g, i, r, c0, c1):
    """Rays of columns c0 … c1 of a row: in the rotated frame, in the grain's voxels, and where they lie in its extents.

    Lengths are voxels.  The rotated frame has its origin at the grain's centre, voxels theirs at voxel [0, 0, 0].
    """
    h, panel = 1.0 / grains.voxel_size, views.panel
    inverse = np.linalg.inv(grains.stretches[g])
    row = r - (panel[0] - 1) / 2
    outer = row_of_rays(views.vectors[i], views.cone, row, grains.positions[g], grains.rotations[g], _NO_CORNER, h)
    o0, corner = _product(inverse, outer[0]), grains.corners[g]
    o0 = (o0[0] - corner[0] * h, o0[1] - corner[1] * h, o0[2] - corner[2] * h)
    inner = (o0, _product(inverse, outer[1]), _product(inverse, outer[2]), _product(inverse, outer[3]))
    span = np.empty((2, c1 - c0), np.float32)
    between(extents, inner[0], inner[1], inner[2], inner[3], c0 - (panel[1] - 1) / 2, span)
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
        for c in range(c0, c1):
            low, high = span[0, c - c0], span[1, c - c0]
            if low > high:
                values[at + c] = 0
                continue
            x = c - middle
            o, d = _at_column(inner[0], inner[1], x), _at_column(inner[2], inner[3], x)
            longer = _length(_at_column(outer[2], outer[3], x)) / _length(d)
            values[at + c] = density * longer * value_at(image, shape, o, d, low, high, grains.voxel_size, exact)


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
        for c in range(c0, c1):
            low, high = span[0, c - c0], span[1, c - c0]
            if low > high:
                values[at + c] = 0
                for k in range(6):
                    derivatives[k, at + c] = by_strain[k, at + c] = 0
                continue
            x = c - middle
            o, d = _at_column(inner[0], inner[1], x), _at_column(inner[2], inner[3], x)
            a, b = _at_column(outer[0], outer[1], x), _at_column(outer[2], outer[3], x)
            total, g_own, h_own = gradients_at(image, shape, o, d, low, high, exact)
            length = density * grains.voxel_size * _length(b)
            integral = length * total
            q = (o[0] + corner[0] * h, o[1] + corner[1] * h, o[2] + corner[2] * h)
            f, w = _scaled(_product(inverse, g_own), -length), _scaled(_product(inverse, h_own), -length)
            by_shift = _product(m, f)
            by_rotation = _product(
                m,
                (
                    a[1] * f[2] - a[2] * f[1] + b[1] * w[2] - b[2] * w[1],
                    a[2] * f[0] - a[0] * f[2] + b[2] * w[0] - b[0] * w[2],
                    a[0] * f[1] - a[1] * f[0] + b[0] * w[1] - b[1] * w[0],
                ),
            )
            values[at + c] = integral
            for n in range(3):
                derivatives[n, at + c] = h * by_shift[n]
                derivatives[3 + n, at + c] = by_rotation[n]
                s, t = (n + 1) % 3, (n + 2) % 3
                by_strain[n, at + c] = f[n] * q[n] + w[n] * d[n] - integral * inverse[n, n]
                by_strain[3 + n, at + c] = (
                    f[s] * q[t] + f[t] * q[s] + w[s] * d[t] + w[t] * d[s] - 2 * integral * inverse[s, t]
                )
