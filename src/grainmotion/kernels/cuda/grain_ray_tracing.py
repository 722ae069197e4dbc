"""Walks along one ray through a grain's voxels, by one thread: line integrals with gradients.

The mathematics is that of `kernels.grain_ray_tracing`; functions of a path return J, G_b, G_c, H_b and H_c.
"""

from __future__ import annotations

import math

import numba as nb
import numpy as np

from grainmotion.kernels.compilation import CACHE

_jit = nb.njit(fastmath=True, inline="never", cache=CACHE, error_model="numpy")
_plain = nb.njit(cache=CACHE, error_model="numpy")
_inlined = nb.njit(cache=CACHE, error_model="numpy", forceinline=True)
_MASK = 0x7FFFFFFF  # lets the compiler know that an index is positive, and so 32 bits wide
_TINY = 1e-20


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


@_inlined
def _on_middle_plane(o, d, sizes):
    """How far the image's middle plane lies from o, 1/d_a, where a ray crosses that plane, and slopes."""
    inverse = 1.0 / d[0]
    kb, kc = d[1] * inverse, d[2] * inverse
    back = sizes[0] // 2 - o[0]
    return back, inverse, o[1] + back * kb, o[2] + back * kc, kb, kc


@_inlined
def _integrals(total, gb, gc, hb, hc, back, inverse):
    """J, G_b, G_c, H_b, H_c from sums over planes k, and of k − middle."""
    scale = abs(inverse)
    hb, hc = (hb + back * gb) * scale * inverse, (hc + back * gc) * scale * inverse
    return total * scale, gb * scale, gc * scale, hb, hc


@_jit
def smooth_value(image, first, count, o, d, strides, sizes):
    """J by bilinear samples on planes first … first + count − 1."""
    f, i4 = image.dtype.type, np.int32
    _, inverse, pb0, pc0, kb, kc = _on_middle_plane(o, d, sizes)
    pb0, pc0, kb, kc = f(pb0), f(pc0), f(kb), f(kc)
    sa, sb, sc = i4(strides[0]), i4(strides[1]), i4(strides[2])
    image_b, image_c, image_bc = image[strides[1] :], image[strides[2] :], image[strides[1] + strides[2] :]
    start, last, end_b, end_c = i4(first), i4(sizes[0] - 1), i4(sizes[1] - 2), i4(sizes[2] - 2)
    zero, middle = i4(0), i4(sizes[0] // 2)
    total = f(0)
    for k in range(np.uint32(count)):
        plane = i4(start + i4(k))
        i = f(i4(plane - middle))
        pb, pc = pb0 + i * kb, pc0 + i * kc
        ib, ic = min(max(i4(pb), zero), end_b), min(max(i4(pc), zero), end_c)
        wb, wc = pb - f(ib), pc - f(ic)
        plane = min(plane, last)
        at = np.uint32(i4(i4(plane * sa) + i4(ib * sb) + i4(ic * sc)) & _MASK)
        v00, v10, v01, v11 = image[at], image_b[at], image_c[at], image_bc[at]
        near = v00 + wb * (v10 - v00)
        total += near + wc * (v01 + wb * (v11 - v01) - near)
    return total * abs(inverse)


@_jit
def smooth_path(image, first, count, o, d, strides, sizes):
    """J, G_b, G_c, H_b, H_c by bilinear samples on planes first … first + count − 1."""
    f, i4 = image.dtype.type, np.int32
    back, inverse, pb0, pc0, kb, kc = _on_middle_plane(o, d, sizes)
    pb0, pc0, kb, kc = f(pb0), f(pc0), f(kb), f(kc)
    sa, sb, sc = i4(strides[0]), i4(strides[1]), i4(strides[2])
    image_b, image_c, image_bc = image[strides[1] :], image[strides[2] :], image[strides[1] + strides[2] :]
    start, last, end_b, end_c = i4(first), i4(sizes[0] - 1), i4(sizes[1] - 2), i4(sizes[2] - 2)
    zero, middle = i4(0), i4(sizes[0] // 2)
    total, gb, gc, hb, hc = f(0), f(0), f(0), f(0), f(0)
    for k in range(np.uint32(count)):
        plane = i4(start + i4(k))
        i = f(i4(plane - middle))
        pb, pc = pb0 + i * kb, pc0 + i * kc
        ib, ic = min(max(i4(pb), zero), end_b), min(max(i4(pc), zero), end_c)
        wb, wc = pb - f(ib), pc - f(ic)
        plane = min(plane, last)
        at = np.uint32(i4(i4(plane * sa) + i4(ib * sb) + i4(ic * sc)) & _MASK)
        v00, v10, v01, v11 = image[at], image_b[at], image_c[at], image_bc[at]
        slope0, slope1 = v10 - v00, v11 - v01
        near = v00 + wb * slope0
        across = v01 + wb * slope1 - near
        along = slope0 + wc * (slope1 - slope0)
        total += near + wc * across
        gb += along
        gc += across
        hb += i * along
        hc += i * across
    return _integrals(total, gb, gc, hb, hc, back, inverse)


@_jit
def exact_value(image, first, count, o, d, strides, sizes):
    """J over the slabs first … first + count − 1; slab k spans k − ½ … k + ½ of the dominant axis."""
    f, i4 = image.dtype.type, np.int32
    _, inverse, pb0, pc0, kb, kc = _on_middle_plane(o, d, sizes)
    pb0, pc0 = f(pb0 + 0.5 - 0.5 * kb), f(pc0 + 0.5 - 0.5 * kc)
    rb, rc = f(1 / kb if abs(kb) > _TINY else 0.0), f(1 / kc if abs(kc) > _TINY else 0.0)
    kb, kc = f(kb), f(kc)
    sa, sb, sc = i4(strides[0]), i4(strides[1]), i4(strides[2])
    start, last, end_b, end_c = i4(first), i4(sizes[0] - 1), i4(sizes[1] - 1), i4(sizes[2] - 1)
    zero, middle = i4(0), i4(sizes[0] // 2)
    total = f(0)
    for k in range(np.uint32(count)):
        plane = i4(start + i4(k))
        i = f(i4(plane - middle))
        pb, pc = pb0 + i * kb, pc0 + i * kc
        eb, xb = min(max(i4(pb), zero), end_b), min(max(i4(pb + kb), zero), end_b)
        ec, xc = min(max(i4(pc), zero), end_c), min(max(i4(pc + kc), zero), end_c)
        tb = (f(max(eb, xb)) - pb) * rb if xb != eb else f(1)
        tc = (f(max(ec, xc)) - pc) * rc if xc != ec else f(1)
        b_first = tb < tc
        mb, mc = (xb, ec) if b_first else (eb, xc)
        plane = i4(min(plane, last) * sa)
        entry = image[np.uint32(i4(plane + i4(eb * sb) + i4(ec * sc)) & _MASK)]
        between = image[np.uint32(i4(plane + i4(mb * sb) + i4(mc * sc)) & _MASK)]
        leave = image[np.uint32(i4(plane + i4(xb * sb) + i4(xc * sc)) & _MASK)]
        total += leave + (entry - between) * min(tb, tc) + (between - leave) * max(tb, tc)
    return total * abs(inverse)


@_jit
def exact_path(image, first, count, o, d, strides, sizes):
    """J, G_b, G_c, H_b, H_c of the exact radiological path; the derivatives are sums of jumps over crossings."""
    f, i4 = image.dtype.type, np.int32
    back, inverse, pb0, pc0, kb, kc = _on_middle_plane(o, d, sizes)
    pb0, pc0 = f(pb0 + 0.5 - 0.5 * kb), f(pc0 + 0.5 - 0.5 * kc)
    rb, rc = f(1 / kb if abs(kb) > _TINY else 0.0), f(1 / kc if abs(kc) > _TINY else 0.0)
    kb, kc = f(kb), f(kc)
    sa, sb, sc = i4(strides[0]), i4(strides[1]), i4(strides[2])
    start, last, end_b, end_c = i4(first), i4(sizes[0] - 1), i4(sizes[1] - 1), i4(sizes[2] - 1)
    zero, middle = i4(0), i4(sizes[0] // 2)
    total, gb, gc, hb, hc = f(0), f(0), f(0), f(0), f(0)
    for k in range(np.uint32(count)):
        plane = i4(start + i4(k))
        i = f(i4(plane - middle))
        pb, pc = pb0 + i * kb, pc0 + i * kc
        eb, xb = min(max(i4(pb), zero), end_b), min(max(i4(pb + kb), zero), end_b)
        ec, xc = min(max(i4(pc), zero), end_c), min(max(i4(pc + kc), zero), end_c)
        tb = (f(max(eb, xb)) - pb) * rb if xb != eb else f(1)
        tc = (f(max(ec, xc)) - pc) * rc if xc != ec else f(1)
        b_first = tb < tc
        mb, mc = (xb, ec) if b_first else (eb, xc)
        plane = i4(min(plane, last) * sa)
        entry = image[np.uint32(i4(plane + i4(eb * sb) + i4(ec * sc)) & _MASK)]
        between = image[np.uint32(i4(plane + i4(mb * sb) + i4(mc * sc)) & _MASK)]
        leave = image[np.uint32(i4(plane + i4(xb * sb) + i4(xc * sc)) & _MASK)]
        e1, e2 = entry - between, between - leave
        jb, jc = (e1, e2) if b_first else (e2, e1)
        total += leave + jb * tb + jc * tc
        gb += jb
        gc += jc
        hb += jb * (i + tb)
        hc += jc * (i + tc)
    # J = Σ (μ_before − μ_after) t: a shift of o_b by 1 moves its crossings by −1/d_b.
    gb, gc, hb, hc = -gb * rb, -gc * rc, -(hb - 0.5 * gb) * rb, -(hc - 0.5 * gc) * rc
    return _integrals(total, gb, gc, hb, hc, back, inverse)
