"""Walks through a grain's voxels: line integrals along one ray, with derivatives, as fast as loads allow.

The mathematics is that of `kernels.ray_tracing`, for images of fewer than 2³¹ voxels, which are **zero on their two
outermost layers**.  A ray is o + t d, in voxels (centres at integers, x y z), d of any length; with J(o, d) = ∫ μ dt
the path functions return

    J, G_b, G_c, H_b, H_c    with  G = ∂J/∂o  and  H = ∂J/∂d,

and the components along the dominant axis a follow from the invariances of a line integral, J(o + t d, d) = J and
J(o, λ d) = J/λ:   G·d = 0,   H·d = −J.

Planes are taken eight at a time, and the last eight go past the end: indices are kept inside the image, and what
lies beyond it reads its empty layers.  Indices are 32 bits wide, so that the loads of eight planes are one gather
each (see `docs/decisions/0011-grain-ray-tracing.md`).
"""

from __future__ import annotations

import math

import numba as nb
import numpy as np

from grainmotion.kernels.compilation import CACHE

_jit = nb.njit(fastmath=True, inline="never", cache=CACHE, error_model="numpy")
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

_MASK = 0x7FFFFFFF  # lets the compiler know that an index is positive, and so 32 bits wide
_EIGHTS = 0x7FFFFFF8
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


@_plain
def ordered(o, d, shape, low, high):
    """The planes that a ray crosses for t in [low, high], as the path functions take them.

    Returns the dominant axis (0 x, 1 y, 2 z), first plane and their number, then o, d, strides and sizes along
    a, b, c.
    """
    nz, ny, nx = np.int64(shape[0]), np.int64(shape[1]), np.int64(shape[2])
    one = np.int64(1)
    ax, ay, az = abs(d[0]), abs(d[1]), abs(d[2])
    if ax >= ay and ax >= az:
        axis, o, d = 0, o, d
        strides, sizes = (one, nx, nx * ny), (nx, ny, nz)
    elif ay >= az:
        axis, o, d = 1, (o[1], o[0], o[2]), (d[1], d[0], d[2])
        strides, sizes = (nx, one, nx * ny), (ny, nx, nz)
    else:
        axis, o, d = 2, (o[2], o[0], o[1]), (d[2], d[0], d[1])
        strides, sizes = (nx * ny, one, nx), (nz, nx, ny)
    k0, k1 = o[0] + low * d[0], o[0] + high * d[0]
    if k0 > k1:
        k0, k1 = k1, k0
    first, last = np.int64(math.ceil(k0)), np.int64(math.floor(k1))  # floats on a GPU
    return axis, first, max(0, last - first + 1), o, d, strides, sizes


@_jit
def smooth_value(image, first, count, o, d, strides, sizes):
    """J by bilinear samples on planes first … first + count − 1."""
    f, i4 = image.dtype.type, np.int32
    inverse = 1.0 / d[0]
    kb, kc = d[1] * inverse, d[2] * inverse
    pb0, pc0 = f(o[1] + (first - o[0]) * kb), f(o[2] + (first - o[0]) * kc)
    kb, kc = f(kb), f(kc)
    sa, sb, sc = i4(strides[0]), i4(strides[1]), i4(strides[2])
    image_b, image_c, image_bc = image[strides[1] :], image[strides[2] :], image[strides[1] + strides[2] :]
    start, last, end_b, end_c = i4(first), i4(sizes[0] - 1), i4(sizes[1] - 2), i4(sizes[2] - 2)
    zero = i4(0)
    total = f(0)
    for k in range(np.uint32((count + 7) & _EIGHTS)):
        i = i4(k)
        pb, pc = pb0 + f(i) * kb, pc0 + f(i) * kc
        ib, ic = min(max(i4(pb), zero), end_b), min(max(i4(pc), zero), end_c)
        wb, wc = pb - f(ib), pc - f(ic)
        plane = min(i4(start + i), last)
        at = np.uint32(i4(i4(plane * sa) + i4(ib * sb) + i4(ic * sc)) & _MASK)
        v00, v10, v01, v11 = image[at], image_b[at], image_c[at], image_bc[at]
        near = v00 + wb * (v10 - v00)
        total += near + wc * (v01 + wb * (v11 - v01) - near)
    return total * abs(inverse)


@_jit
def smooth_path(image, first, count, o, d, strides, sizes):
    """J, G_b, G_c, H_b, H_c by bilinear samples on planes first … first + count − 1."""
    f, i4 = image.dtype.type, np.int32
    inverse = 1.0 / d[0]
    kb, kc = d[1] * inverse, d[2] * inverse
    pb0, pc0 = f(o[1] + (first - o[0]) * kb), f(o[2] + (first - o[0]) * kc)
    kb, kc = f(kb), f(kc)
    t0, dt = f((first - o[0]) * inverse), f(inverse)
    sa, sb, sc = i4(strides[0]), i4(strides[1]), i4(strides[2])
    image_b, image_c, image_bc = image[strides[1] :], image[strides[2] :], image[strides[1] + strides[2] :]
    start, last, end_b, end_c = i4(first), i4(sizes[0] - 1), i4(sizes[1] - 2), i4(sizes[2] - 2)
    zero = i4(0)
    total, gb, gc, hb, hc = f(0), f(0), f(0), f(0), f(0)
    for k in range(np.uint32((count + 7) & _EIGHTS)):
        i = i4(k)
        pb, pc = pb0 + f(i) * kb, pc0 + f(i) * kc
        ib, ic = min(max(i4(pb), zero), end_b), min(max(i4(pc), zero), end_c)
        wb, wc = pb - f(ib), pc - f(ic)
        plane = min(i4(start + i), last)
        at = np.uint32(i4(i4(plane * sa) + i4(ib * sb) + i4(ic * sc)) & _MASK)
        v00, v10, v01, v11 = image[at], image_b[at], image_c[at], image_bc[at]
        slope0, slope1 = v10 - v00, v11 - v01
        near = v00 + wb * slope0
        across = v01 + wb * slope1 - near
        along = slope0 + wc * (slope1 - slope0)
        t = t0 + f(i) * dt
        total += near + wc * across
        gb += along
        gc += across
        hb += t * along
        hc += t * across
    scale = abs(inverse)
    return total * scale, gb * scale, gc * scale, hb * scale, hc * scale


@_jit
def exact_value(image, first, count, o, d, strides, sizes):
    """J over the slabs first … first + count − 1; slab k spans k − ½ … k + ½ of the dominant axis."""
    f, i4 = image.dtype.type, np.int32
    inverse = 1.0 / d[0]
    kb, kc = d[1] * inverse, d[2] * inverse
    pb0, pc0 = f(o[1] + 0.5 + (first - 0.5 - o[0]) * kb), f(o[2] + 0.5 + (first - 0.5 - o[0]) * kc)
    rb, rc = f(1 / kb if abs(kb) > _TINY else 0.0), f(1 / kc if abs(kc) > _TINY else 0.0)
    kb, kc = f(kb), f(kc)
    sa, sb, sc = i4(strides[0]), i4(strides[1]), i4(strides[2])
    start, last, end_b, end_c = i4(first), i4(sizes[0] - 1), i4(sizes[1] - 1), i4(sizes[2] - 1)
    zero = i4(0)
    total = f(0)
    for k in range(np.uint32((count + 7) & _EIGHTS)):
        i = i4(k)
        pb, pc = pb0 + f(i) * kb, pc0 + f(i) * kc
        eb, xb = min(max(i4(pb), zero), end_b), min(max(i4(pb + kb), zero), end_b)
        ec, xc = min(max(i4(pc), zero), end_c), min(max(i4(pc + kc), zero), end_c)
        tb = (f(max(eb, xb)) - pb) * rb if xb != eb else f(1)
        tc = (f(max(ec, xc)) - pc) * rc if xc != ec else f(1)
        b_first = tb < tc
        mb, mc = (xb, ec) if b_first else (eb, xc)
        plane = i4(min(i4(start + i), last) * sa)
        entry = image[np.uint32(i4(plane + i4(eb * sb) + i4(ec * sc)) & _MASK)]
        middle = image[np.uint32(i4(plane + i4(mb * sb) + i4(mc * sc)) & _MASK)]
        leave = image[np.uint32(i4(plane + i4(xb * sb) + i4(xc * sc)) & _MASK)]
        total += leave + (entry - middle) * min(tb, tc) + (middle - leave) * max(tb, tc)
    return total * abs(inverse)


@_jit
def exact_path(image, first, count, o, d, strides, sizes):
    """J, G_b, G_c, H_b, H_c of the exact radiological path; the derivatives are sums of jumps over crossings."""
    f, i4 = image.dtype.type, np.int32
    inverse = 1.0 / d[0]
    kb, kc = d[1] * inverse, d[2] * inverse
    pb0, pc0 = f(o[1] + 0.5 + (first - 0.5 - o[0]) * kb), f(o[2] + 0.5 + (first - 0.5 - o[0]) * kc)
    rb, rc = f(1 / kb if abs(kb) > _TINY else 0.0), f(1 / kc if abs(kc) > _TINY else 0.0)
    kb, kc = f(kb), f(kc)
    # Entering planes in the direction of growing k; t grows with k only if d_a > 0.
    t0, dt = f((first - 0.5 - o[0]) * inverse), f(inverse)
    sa, sb, sc = i4(strides[0]), i4(strides[1]), i4(strides[2])
    start, last, end_b, end_c = i4(first), i4(sizes[0] - 1), i4(sizes[1] - 1), i4(sizes[2] - 1)
    zero = i4(0)
    total, gb, gc, hb, hc = f(0), f(0), f(0), f(0), f(0)
    for k in range(np.uint32((count + 7) & _EIGHTS)):
        i = i4(k)
        pb, pc = pb0 + f(i) * kb, pc0 + f(i) * kc
        eb, xb = min(max(i4(pb), zero), end_b), min(max(i4(pb + kb), zero), end_b)
        ec, xc = min(max(i4(pc), zero), end_c), min(max(i4(pc + kc), zero), end_c)
        tb = (f(max(eb, xb)) - pb) * rb if xb != eb else f(1)
        tc = (f(max(ec, xc)) - pc) * rc if xc != ec else f(1)
        b_first = tb < tc
        mb, mc = (xb, ec) if b_first else (eb, xc)
        plane = i4(min(i4(start + i), last) * sa)
        entry = image[np.uint32(i4(plane + i4(eb * sb) + i4(ec * sc)) & _MASK)]
        middle = image[np.uint32(i4(plane + i4(mb * sb) + i4(mc * sc)) & _MASK)]
        leave = image[np.uint32(i4(plane + i4(xb * sb) + i4(xc * sc)) & _MASK)]
        e1, e2 = entry - middle, middle - leave
        jb, jc = (e1, e2) if b_first else (e2, e1)
        total += leave + jb * tb + jc * tc
        gb += jb
        gc += jc
        hb += jb * (t0 + (f(i) + tb) * dt)
        hc += jc * (t0 + (f(i) + tc) * dt)
    # J = Σ (μ_before − μ_after) t: a shift of o_b by 1 moves its crossings by −1/d_b.
    scale = abs(inverse)
    return total * scale, -gb * rb * scale, -gc * rc * scale, -hb * rb * scale, -hc * rc * scale
