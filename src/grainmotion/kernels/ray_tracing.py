"""The line integral of a voxel image along one ray.

A ray is o + s d, with o and d in voxels (voxel centres at integers, x y z) and s in mm, so that
``|d|`` = 1/voxel size.  The image is flat, C order, and **zero on its two outermost layers**; strides are
counted in voxels.  Both projectors step along the ray's dominant axis a (the largest ``|d|``), one voxel
at a time, with b and c the two other axes; those with derivatives are in `kernels.grain_ray_tracing`.

`smooth_value` samples the trilinear image on the planes of voxel centres, where trilinear is bilinear
(trapezoidal rule, one sample a voxel along a: Joseph 1982).  `exact_value` is the exact radiological
path of the piecewise-constant image (Siddon 1985, Jacobs 1998) by slabs: a slab holds at most three
voxels of a ray (entry, middle, exit), so with t the fractions of the slab at which the planes of b
and c are crossed (1 if they are not), its mean is  μ_exit + g_b t_b + g_c t_c.
"""

from __future__ import annotations

import math

import numba as nb
import numpy as np

from grainmotion.kernels.compilation import CACHE

_jit = nb.njit(fastmath=True, inline="never", cache=CACHE, error_model="numpy")


@nb.njit(cache=CACHE, error_model="numpy")
def clip_range(o, d, n, low, high):
    """Narrow the interval [low, high] of s to where  edge <= o + s d <= n − 1 − edge."""
    edge = 1e-3
    if d == 0.0:
        if o < edge or o > n - 1 - edge:
            return 1.0, 0.0
        return low, high
    s0 = (edge - o) / d
    s1 = (n - 1 - edge - o) / d
    if s0 > s1:
        s0, s1 = s1, s0
    return max(low, s0), min(high, s1)


@nb.njit(cache=CACHE, error_model="numpy")
def enter(ox, oy, oz, dx, dy, dz, nx, ny, nz, exact):
    """The path of a ray through an image of nx × ny × nz voxels, in the order its path functions take it.

    Returns the dominant axis (0 x, 1 y, 2 z), the first plane (or slab) and their number, then
    o and d along a, b, c and the strides of a, b, c.  The image must be zero on its two outermost layers.
    """
    low, high = clip_range(ox, dx, nx, -np.inf, np.inf)
    low, high = clip_range(oy, dy, ny, low, high)
    low, high = clip_range(oz, dz, nz, low, high)
    ax, ay, az = abs(dx), abs(dy), abs(dz)
    if ax >= ay and ax >= az:
        axis, oa, ob, oc, da, db, dc, sa, sb, sc = 0, ox, oy, oz, dx, dy, dz, 1, nx, nx * ny
    elif ay >= az:
        axis, oa, ob, oc, da, db, dc, sa, sb, sc = 1, oy, ox, oz, dy, dx, dz, nx, 1, nx * ny
    else:
        axis, oa, ob, oc, da, db, dc, sa, sb, sc = 2, oz, ox, oy, dz, dx, dy, nx * ny, 1, nx
    none = np.int64(0)
    first, count = none, none
    if low < high:
        k0, k1 = oa + low * da, oa + high * da
        if k0 > k1:
            k0, k1 = k1, k0
        half = 0.5 if exact else 0.0
        first = np.int64(math.ceil(k0 + half))  # a float on a GPU
        count = max(none, np.int64(math.floor(k1 - half)) - first + 1)
    return axis, first, count, oa, ob, oc, da, db, dc, sa, sb, sc


@nb.njit(cache=CACHE, error_model="numpy")
def pixel_ray(view, cone, row, column):
    """A point on the ray through a pixel (counted from the panel's centre) and its unit direction, mm."""
    px = view[3] + column * view[6] + row * view[9]
    py = view[4] + column * view[7] + row * view[10]
    pz = view[5] + column * view[8] + row * view[11]
    if cone:
        dx, dy, dz = px - view[0], py - view[1], pz - view[2]
    else:
        dx, dy, dz = view[0], view[1], view[2]
    scale = 1.0 / math.sqrt(dx * dx + dy * dy + dz * dz)
    return px, py, pz, dx * scale, dy * scale, dz * scale


@_jit
def smooth_value(image, first, count, oa, ob, oc, da, db, dc, sa, sb, sc):
    """I by bilinear samples on planes first … first + count − 1."""
    f = image.dtype.type
    kb, kc = db / da, dc / da
    pb0, pc0 = f(ob + (first - oa) * kb), f(oc + (first - oa) * kc)
    kb, kc = f(kb), f(kc)
    sa, sb, sc = np.uint32(sa), np.uint32(sb), np.uint32(sc)
    start = np.uint32(first) * sa
    total = f(0)
    for k in range(np.uint32(count)):
        pb, pc = pb0 + f(k) * kb, pc0 + f(k) * kc
        ib, ic = np.uint32(np.int32(pb)), np.uint32(np.int32(pc))
        wb, wc = pb - f(np.int32(ib)), pc - f(np.int32(ic))
        base = start + np.uint32(k) * sa + ib * sb + ic * sc
        v00, v10 = image[base], image[base + sb]
        v01, v11 = image[base + sc], image[base + sb + sc]
        near = v00 + wb * (v10 - v00)
        total += near + wc * (v01 + wb * (v11 - v01) - near)
    return total / abs(da)


@_jit
def exact_value(image, first, count, oa, ob, oc, da, db, dc, sa, sb, sc):
    """I over the slabs first … first + count − 1; slab k spans k − ½ … k + ½ of the dominant axis."""
    f = image.dtype.type
    kb, kc = db / da, dc / da
    pb0, pc0 = f(ob + 0.5 + (first - 0.5 - oa) * kb), f(oc + 0.5 + (first - 0.5 - oa) * kc)
    kb, kc = f(kb), f(kc)
    rb = f(1) / kb if kb != 0 else f(0)
    rc = f(1) / kc if kc != 0 else f(0)
    sa, sb, sc = np.uint32(sa), np.uint32(sb), np.uint32(sc)
    start = np.uint32(first) * sa
    total = f(0)
    for k in range(np.uint32(count)):
        pb, pc = pb0 + f(k) * kb, pc0 + f(k) * kc
        eb, ec = np.int32(pb), np.int32(pc)
        xb, xc = np.int32(pb + kb), np.int32(pc + kc)
        tb = (f(max(eb, xb)) - pb) * rb if xb != eb else f(1)
        tc = (f(max(ec, xc)) - pc) * rc if xc != ec else f(1)
        b_first = tb < tc
        mb, mc = (xb, ec) if b_first else (eb, xc)
        base = start + np.uint32(k) * sa
        entry = image[base + np.uint32(eb) * sb + np.uint32(ec) * sc]
        middle = image[base + np.uint32(mb) * sb + np.uint32(mc) * sc]
        leave = image[base + np.uint32(xb) * sb + np.uint32(xc) * sc]
        e1, e2 = entry - middle, middle - leave
        total += leave + e1 * min(tb, tc) + e2 * max(tb, tc)
    return total / abs(da)


@nb.njit(cache=CACHE, error_model="numpy", forceinline=True)
def line_integral(image, shape, o, d, exact):
    """I of the ray o + s d through an image of ``shape`` (z, y, x)."""
    _, first, count, oa, ob, oc, da, db, dc, sa, sb, sc = enter(
        o[0], o[1], o[2], d[0], d[1], d[2], shape[2], shape[1], shape[0], exact
    )
    if count == 0:
        return 0.0
    if exact:
        return exact_value(image, first, count, oa, ob, oc, da, db, dc, sa, sb, sc)
    return smooth_value(image, first, count, oa, ob, oc, da, db, dc, sa, sb, sc)
