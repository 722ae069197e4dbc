"""Line integrals along eight rays at once through a grain's voxels, with derivatives.

The mathematics is that of `kernels.grain_ray_tracing`.  The rays of eight neighbouring pixels, one in each lane of a
vector (`kernels.vectors`), go together from plane to plane of their dominant axis, from the first that any of them
needs to the last: t = (k − o_a)/d_a on plane k.  What a ray reads beyond its own planes are empty voxels, and where it
leaves the image, indices are caught in the empty layers at its edge.  Both add zeros: the result of a ray is the same,
bit by bit, next to any other rays.  If their dominant axes differ, they are traced one axis after the other.

A sample needs the four voxels around it.  Two of them lie together, unless x is the dominant axis, and are read by one
load (see `docs/decisions/0052-eight-rays-at-once.md`).
"""

from __future__ import annotations

import math

import numba as nb
import numpy as np

from grainmotion.kernels.compilation import CACHE
from grainmotion.kernels.grain_ray_tracing import FAR
from grainmotion.kernels.vector_functions import (
    absolute,
    any_lane,
    as_double,
    as_precision,
    inside,
    largest,
    least,
    maximum,
    minimum,
    spread,
    truncated,
    where,
)
from grainmotion.kernels.vector_memory import gathered, pairs

_inlined = nb.njit(cache=CACHE, error_model="numpy", forceinline=True)
_jit = nb.njit(cache=CACHE, error_model="numpy")
PACKET_SIZE = 8  # rays that are traced at once
_TINY = 1e-20


@_inlined
def values(image, shape, o, d, low, high, exact):
    """J of the rays o + t d, t from low to high, in a grain's voxels; rays whose low exceeds their high have J = 0."""
    total = spread(0.0, PACKET_SIZE)
    for axis in range(3):
        own = (low <= high) & dominant(d, axis)
        if any_lane(own):
            planes, ray, _, inverse, layout = crossing(shape, o, d, low, high, own, axis)
            if exact:
                j = _exact_sum(image, planes, ray, layout)
            elif axis == 0:
                j = _smooth_sum(image, planes, ray, layout, False)
            else:
                j = _smooth_sum(image, planes, ray, layout, True)
            total = where(own, j * absolute(inverse), total)
    return total


@_inlined
def gradients(image, shape, o, d, low, high, exact):
    """J as `values`, and its gradients G by o and H by d."""
    zero = spread(0.0, PACKET_SIZE)
    total, gx, gy, gz, hx, hy, hz = zero, zero, zero, zero, zero, zero, zero
    for axis in range(3):
        own = (low <= high) & dominant(d, axis)
        if any_lane(own):
            planes, ray, back, inverse, layout = crossing(shape, o, d, low, high, own, axis)
            if exact:
                j, gb, gc, hb, hc = _exact_sums(image, planes, ray, layout)
            elif axis == 0:
                j, gb, gc, hb, hc = _smooth_sums(image, planes, ray, layout, False)
            else:
                j, gb, gc, hb, hc = _smooth_sums(image, planes, ray, layout, True)
            # sums over planes k to integrals over t, and of k − middle to t
            length = absolute(inverse)
            hb, hc = (hb + back * gb) * length * inverse, (hc + back * gc) * length * inverse
            j, gb, gc = j * length, gb * length, gc * length
            # along a by the invariances of a line integral
            _, _, kb, kc = ray
            ga, ha = -(gb * kb + gc * kc), -(j * inverse + hb * kb + hc * kc)
            ga, gb, gc = _from_axis(axis, ga, gb, gc)
            ha, hb, hc = _from_axis(axis, ha, hb, hc)
            total = where(own, j, total)
            gx, gy, gz = where(own, ga, gx), where(own, gb, gy), where(own, gc, gz)
            hx, hy, hz = where(own, ha, hx), where(own, hb, hy), where(own, hc, hz)
    return total, (gx, gy, gz), (hx, hy, hz)


@_inlined
def dominant(d, axis):
    """Lanes in which an axis is the dominant one, the first of equal ones."""
    x, y, z = absolute(d[0]), absolute(d[1]), absolute(d[2])
    if axis == 0:
        return (y <= x) & (z <= x)
    if axis == 1:
        return (x < maximum(y, z)) & (z <= y)
    return (x < z) & (y < z)


@_inlined
def _to_axis(axis, x, y, z):
    """What belongs to the axes a, b and c."""
    if axis == 0:
        return x, y, z
    if axis == 1:
        return y, x, z
    return z, x, y


@_inlined
def _from_axis(axis, a, b, c):
    """What belongs to the axes x, y and z."""
    if axis == 0:
        return a, b, c
    if axis == 1:
        return b, a, c
    return b, c, a


@_inlined
def crossing(shape, o, d, low, high, own, axis):
    """Planes that the rays of some lanes cross, and where, with an axis as the dominant one.

    Returns the first plane, the end and the middle one of the image; the rays' places (b, c) on the middle plane and
    their slopes; how far the middle plane lies from o; 1/d_a; and strides and sizes of the image.
    """
    one, nx, ny, nz = np.int64(1), np.int64(shape[2]), np.int64(shape[1]), np.int64(shape[0])
    strides, sizes = _to_axis(axis, one, nx, nx * ny), _to_axis(axis, nx, ny, nz)
    oa, ob, oc = _to_axis(axis, o[0], o[1], o[2])
    da, db, dc = _to_axis(axis, d[0], d[1], d[2])
    enter, leave = oa + low * da, oa + high * da
    first = max(least(where(own, minimum(enter, leave), FAR)), 0.0)
    last = min(largest(where(own, maximum(enter, leave), -FAR)), sizes[0] - 1.0)
    inverse = 1.0 / where(own, da, 1.0)
    kb, kc = where(own, db, 0.0) * inverse, where(own, dc, 0.0) * inverse
    planes = np.int64(math.ceil(first)), np.int64(math.floor(last)) + 1, sizes[0] // 2
    back = planes[2] - oa
    return planes, (ob + back * kb, oc + back * kc, kb, kc), back, inverse, (strides, sizes)


@_inlined
def _rounded(image, ray):
    """Places and slopes in the image's precision, and zeros to begin sums with."""
    pb, pc, kb, kc = ray
    zero = as_precision(spread(0.0, PACKET_SIZE), image)
    return as_precision(pb, image), as_precision(pc, image), as_precision(kb, image), as_precision(kc, image), zero


@_inlined
def _corners(image, start, b, c, layout, paired):
    """The four voxels around places (b, c) of the plane that begins at ``start``, and the places' weights."""
    i4, (_, sb, sc), (_, nb_, nc) = np.int32, layout[0], layout[1]
    ib, ic = inside(truncated(b), i4(nb_ - 2)), inside(truncated(c), i4(nc - 2))
    wb, wc = b - as_precision(ib, image), c - as_precision(ic, image)
    if paired:
        at = ib + ic * i4(sc)
        v00, v10 = pairs(image, start, at)
        v01, v11 = pairs(image, start + sc, at)
    else:
        at = ib * i4(sb) + ic * i4(sc)
        v00, v10 = gathered(image, start, at), gathered(image, start + sb, at)
        v01, v11 = gathered(image, start + sc, at), gathered(image, start + sb + sc, at)
    return v00, v10, v01, v11, wb, wc


@_jit
def _smooth_sum(image, planes, ray, layout, paired):
    """Sum of bilinear samples on the planes."""
    f, step = image.dtype.type, layout[0][0]
    pb, pc, kb, kc, total = _rounded(image, ray)
    for k in range(planes[0], planes[1]):
        i = f(k - planes[2])
        v00, v10, v01, v11, wb, wc = _corners(image, k * step, pb + i * kb, pc + i * kc, layout, paired)
        near = v00 + wb * (v10 - v00)
        total = total + (near + wc * (v01 + wb * (v11 - v01) - near))
    return as_double(total)


@_jit
def _smooth_sums(image, planes, ray, layout, paired):
    """Sums of bilinear samples, of their slopes along b and c, and of these times k − middle."""
    f, step = image.dtype.type, layout[0][0]
    pb, pc, kb, kc, zero = _rounded(image, ray)
    total, gb, gc, hb, hc = zero, zero, zero, zero, zero
    for k in range(planes[0], planes[1]):
        i = f(k - planes[2])
        v00, v10, v01, v11, wb, wc = _corners(image, k * step, pb + i * kb, pc + i * kc, layout, paired)
        slope0, slope1 = v10 - v00, v11 - v01
        near = v00 + wb * slope0
        across = v01 + wb * slope1 - near
        along = slope0 + wc * (slope1 - slope0)
        total = total + (near + wc * across)
        gb, gc = gb + along, gc + across
        hb, hc = hb + i * along, hc + i * across
    return as_double(total), as_double(gb), as_double(gc), as_double(hb), as_double(hc)


@_inlined
def _voxels_of_slab(image, start, b, c, slopes, layout):
    """The voxels in which rays enter and leave a slab, and between; where they cross faces, and if one of b first.

    (b, c) are places on the slab's first face, in voxels from the image's corner, and ``slopes`` kb, kc, 1/kb, 1/kc.
    """
    i4, (_, sb, sc), (_, nb_, nc) = np.int32, layout[0], layout[1]
    kb, kc, rb, rc = slopes
    eb, xb = inside(truncated(b), i4(nb_ - 1)), inside(truncated(b + kb), i4(nb_ - 1))
    ec, xc = inside(truncated(c), i4(nc - 1)), inside(truncated(c + kc), i4(nc - 1))
    tb = where(xb != eb, (as_precision(maximum(eb, xb), image) - b) * rb, 1.0)
    tc = where(xc != ec, (as_precision(maximum(ec, xc), image) - c) * rc, 1.0)
    b_first = tb < tc
    eb, xb, ec, xc = eb * i4(sb), xb * i4(sb), ec * i4(sc), xc * i4(sc)
    entry, leave = gathered(image, start, eb + ec), gathered(image, start, xb + xc)
    return entry, gathered(image, start, where(b_first, xb + ec, eb + xc)), leave, tb, tc, b_first


@_inlined
def _reciprocal(k):
    """1/k, and 0 for a k of almost 0."""
    small = absolute(k) <= _TINY
    return where(small, 0.0, 1.0 / where(small, 1.0, k))


@_inlined
def _slabs(image, ray):
    """`_rounded`, on the first faces of slabs, with the slopes as of `_voxels_of_slab`."""
    pb, pc, kb, kc = ray
    pb, pc, kb, kc, zero = _rounded(image, (pb + 0.5 - 0.5 * kb, pc + 0.5 - 0.5 * kc, kb, kc))
    rb, rc = as_precision(_reciprocal(ray[2]), image), as_precision(_reciprocal(ray[3]), image)
    return pb, pc, (kb, kc, rb, rc), zero


@_jit
def _exact_sum(image, planes, ray, layout):
    """Sum of the voxels in the slabs k − ½ … k + ½ times the shares of the slab in which a ray is in them."""
    f, step = image.dtype.type, layout[0][0]
    pb, pc, slopes, total = _slabs(image, ray)
    for k in range(planes[0], planes[1]):
        i = f(k - planes[2])
        b, c = pb + i * slopes[0], pc + i * slopes[1]
        entry, between, leave, tb, tc, _ = _voxels_of_slab(image, k * step, b, c, slopes, layout)
        total = total + (leave + (entry - between) * minimum(tb, tc) + (between - leave) * maximum(tb, tc))
    return as_double(total)


@_jit
def _exact_sums(image, planes, ray, layout):
    """As `_smooth_sums`, of the exact radiological path: derivatives are sums of jumps over the crossings of faces."""
    f, step = image.dtype.type, layout[0][0]
    pb, pc, slopes, zero = _slabs(image, ray)
    total, gb, gc, hb, hc = zero, zero, zero, zero, zero
    for k in range(planes[0], planes[1]):
        i = f(k - planes[2])
        b, c = pb + i * slopes[0], pc + i * slopes[1]
        entry, between, leave, tb, tc, b_first = _voxels_of_slab(image, k * step, b, c, slopes, layout)
        one, two = entry - between, between - leave
        jb, jc = where(b_first, one, two), where(b_first, two, one)
        total = total + (leave + jb * tb + jc * tc)
        gb, gc = gb + jb, gc + jc
        hb, hc = hb + jb * (i + tb), hc + jc * (i + tc)
    # J = Σ (μ_before − μ_after) t: a shift of o_b by 1 moves its crossings by −1/d_b, and slabs begin at k − ½.
    rb, rc = -_reciprocal(ray[2]), -_reciprocal(ray[3])
    gb, gc = as_double(gb), as_double(gc)
    return as_double(total), gb * rb, gc * rc, (as_double(hb) - 0.5 * gb) * rb, (as_double(hc) - 0.5 * gc) * rc
