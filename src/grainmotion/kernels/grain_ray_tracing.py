"""Rays of a row of pixels in a grain's voxels, where they meet the grain, and what line integrals along them are.

A ray is o + t d, in voxels (centres at integers, x y z), d of any length.  With J(o, d) = ∫ μ dt, kernels give

    J,  G = ∂J/∂o  and  H = ∂J/∂d,

by sums over the planes of voxels along the dominant axis a, the one along which d is longest; b and c are the others.
The components along a follow from the invariances of a line integral, J(o + t d, d) = J and J(o, λ d) = J/λ:
G·d = 0 and H·d = −J.  Images are **zero on their two outermost layers** and have fewer than 2³¹ voxels.

`grain_ray_packets` traces eight rays at once on a CPU, `cuda.grain_ray_tracing` one in each thread of a GPU (see
`docs/decisions/0011-grain-ray-tracing.md` and `0052-eight-rays-at-once.md`).
"""

from __future__ import annotations

import numba as nb
import numpy as np

from grainmotion.kernels.compilation import CACHE

_plain = nb.njit(cache=CACHE, error_model="numpy")
_inlined = nb.njit(fastmath=True, cache=CACHE, error_model="numpy", forceinline=True)

DIRECTIONS = np.array(
    [
        (1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 1, 0), (1, -1, 0), (1, 0, 1), (1, 0, -1), (0, 1, 1), (0, 1, -1),
        (1, 1, 1), (1, 1, -1), (1, -1, 1), (-1, 1, 1),
    ],
    np.float32,
)  # fmt: skip
"""Normals (x y z) of the pairs of planes between which a grain lies: faces, edges and corners of a cube."""

REACH = np.where(np.abs(DIRECTIONS).sum(axis=1) == 1, 1.0, 2.0) + 0.02
"""How far beyond its centre a voxel counts along each of them, voxels: where a ray crosses a plane of the dominant
axis, at most 1 along either other axis, and the rounding of `between`."""

_TINY = 1e-20
FAR = 1e30
"""Beyond any t."""


@_plain
def row_of_rays(view, cone, row, position, matrix, corner, h):
    """The rays of a row of pixels in a grain's voxels: that of column c has o = o₀ + c o₁ and d = d₀ + c d₁.

    Row and column count from the panel's centre.  o lies on the plane through the grain's ``position`` parallel to
    the panel, which keeps single-precision sums short.  Returns o₀, o₁, d₀, d₁.
    """
    px, py, pz = view[3] + row * view[9], view[4] + row * view[10], view[5] + row * view[11]
    ux, uy, uz = view[6], view[7], view[8]
    vx, vy, vz = view[9], view[10], view[11]
    nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    if cone:
        sx, sy, sz = view[0], view[1], view[2]
        dx, dy, dz = px - sx, py - sy, pz - sz
    else:
        sx, sy, sz = px, py, pz
        dx, dy, dz = view[0], view[1], view[2]
    yx, yy, yz = sx - position[0], sy - position[1], sz - position[2]
    slope = dx * nx + dy * ny + dz * nz
    t = -(yx * nx + yy * ny + yz * nz) / slope if slope != 0 else 0.0
    back, turn = (t * h, h) if cone else (h, 0.0)
    o = _turned_back(matrix, yx + t * dx, yy + t * dy, yz + t * dz, h)
    ux, uy, uz = _turned_back(matrix, ux, uy, uz, 1.0)
    return (
        (o[0] - corner[0] * h, o[1] - corner[1] * h, o[2] - corner[2] * h),
        (ux * back, uy * back, uz * back),
        _turned_back(matrix, dx, dy, dz, h),
        (ux * turn, uy * turn, uz * turn),
    )


@_plain
def _turned_back(m, x, y, z, h):
    """h Ωᵀ (x, y, z)."""
    return (
        (m[0, 0] * x + m[1, 0] * y + m[2, 0] * z) * h,
        (m[0, 1] * x + m[1, 1] * y + m[2, 1] * z) * h,
        (m[0, 2] * x + m[1, 2] * y + m[2, 2] * z) * h,
    )


@nb.njit(fastmath=True, cache=CACHE, error_model="numpy")
def between(extents, o0, o1, d0, d1, start, span):
    """Where the rays of a row lie between all pairs of planes: ``span (2, columns)`` gets the interval of t.

    ``extents (2, directions)`` are the planes' places along `DIRECTIONS`; the first column is ``start``.  A ray
    that misses the grain has an interval that ends before it begins.  Rounds to single precision.
    """
    f = np.float32
    low, high = span[0], span[1]
    low[:], high[:] = f(-FAR), f(FAR)
    for j in range(len(DIRECTIONS)):
        line = along(j, o0, o1, d0, d1, start)
        first, last = f(extents[0, j]), f(extents[1, j])
        for c in range(np.uint32(len(low))):
            low[c], high[c] = narrowed(low[c], high[c], line, f(np.int32(c)), first, last)


@_inlined
def along(j, o0, o1, d0, d1, start):
    """Place and slope of the rays of a row along one of `DIRECTIONS`: at column ``start`` p₀, q₀, a column more p₁, q₁.

    Returns p₀, p₁, q₀, q₁.
    """
    f = np.float32
    nx, ny, nz = DIRECTIONS[j, 0], DIRECTIONS[j, 1], DIRECTIONS[j, 2]
    place, place_step = nx * o0[0] + ny * o0[1] + nz * o0[2], nx * o1[0] + ny * o1[1] + nz * o1[2]
    slope, slope_step = nx * d0[0] + ny * d0[1] + nz * d0[2], nx * d1[0] + ny * d1[1] + nz * d1[2]
    return f(place + start * place_step), f(place_step), f(slope + start * slope_step), f(slope_step)


@_inlined
def narrowed(low, high, line, c, first, last):
    """The interval [low, high] of t, cut to where the ray of column c of `along` lies between two planes."""
    f, tiny = np.float32, np.float32(_TINY)
    p, q = line[0] + c * line[1], line[2] + c * line[3]
    inverse = f(1) / (q if abs(q) > tiny else tiny)
    enter, leave = (first - p) * inverse, (last - p) * inverse
    return max(low, min(enter, leave)), min(high, max(enter, leave))
