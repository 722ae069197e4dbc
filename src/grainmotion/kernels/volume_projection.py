"""Forward projection of a whole volume, and its exact adjoint.

The image is ``(nz, ny, nx)`` and zero on its two outermost layers; ``origin`` is the position of voxel
[0, 0, 0] (x y z, mm).  The adjoint scatters.  Threads share the planes of the rays' dominant axis among
them, so that no two write the same voxel and the sums come in the same order whatever the thread count.
"""

from __future__ import annotations

import numba as nb
import numpy as np

from grainmotion.kernels.compilation import CACHE
from grainmotion.kernels.ray_tracing import enter, line_integral, pixel_ray

CHUNKS = 4  # slices of the dominant axis that the adjoint hands to threads


@nb.njit(parallel=True, cache=CACHE, error_model="numpy")
def forward(image, origin, voxel, views, cone, exact, out):
    """Line integrals ``out (views, rows, columns)`` of ``image``."""
    flat = image.ravel()
    n, rows, columns = out.shape
    h = 1.0 / voxel
    for job in nb.prange(n * rows):
        i, r = job // rows, job % rows
        for c in range(columns):
            px, py, pz, dx, dy, dz = pixel_ray(views[i], cone, r - (rows - 1) / 2, c - (columns - 1) / 2)
            ox, oy, oz = (px - origin[0]) * h, (py - origin[1]) * h, (pz - origin[2]) * h
            out[i, r, c] = line_integral(flat, image.shape, (ox, oy, oz), (dx * h, dy * h, dz * h), exact)


@nb.njit(cache=CACHE, error_model="numpy", forceinline=True)
def add_to(image, index, value):
    """Add to a voxel; on a GPU, where threads share voxels, another function has this name."""
    image[index] += value


@nb.njit(cache=CACHE, error_model="numpy")
def scatter_smooth(image, value, first, count, oa, ob, oc, da, db, dc, sa, sb, sc):
    """The transpose of `ray_tracing.smooth_value`: spread a ray's value over the voxels that it samples."""
    f = image.dtype.type
    kb, kc = db / da, dc / da
    pb0, pc0 = f(ob + (first - oa) * kb), f(oc + (first - oa) * kc)
    kb, kc = f(kb), f(kc)
    weight = f(value / abs(da))
    sa, sb, sc = np.uint32(sa), np.uint32(sb), np.uint32(sc)
    start = np.uint32(first) * sa
    for k in range(np.uint32(count)):
        pb, pc = pb0 + f(k) * kb, pc0 + f(k) * kc
        ib, ic = np.int32(pb), np.int32(pc)
        wb, wc = pb - f(ib), pc - f(ic)
        base = start + np.uint32(k) * sa + np.uint32(ib) * sb + np.uint32(ic) * sc
        far = weight * wc
        near = weight - far
        far_b, near_b = far * wb, near * wb
        add_to(image, base, near - near_b)
        add_to(image, base + sb, near_b)
        add_to(image, base + sc, far - far_b)
        add_to(image, base + sb + sc, far_b)


@nb.njit(cache=CACHE, error_model="numpy")
def scatter_exact(image, value, first, count, oa, ob, oc, da, db, dc, sa, sb, sc):
    """The transpose of `ray_tracing.exact_value`."""
    f = image.dtype.type
    kb, kc = db / da, dc / da
    pb0, pc0 = f(ob + 0.5 + (first - 0.5 - oa) * kb), f(oc + 0.5 + (first - 0.5 - oa) * kc)
    kb, kc = f(kb), f(kc)
    rb = f(1) / kb if kb != 0 else f(0)
    rc = f(1) / kc if kc != 0 else f(0)
    weight = f(value / abs(da))
    sa, sb, sc = np.uint32(sa), np.uint32(sb), np.uint32(sc)
    start = np.uint32(first) * sa
    for k in range(np.uint32(count)):
        pb, pc = pb0 + f(k) * kb, pc0 + f(k) * kc
        eb, ec = np.int32(pb), np.int32(pc)
        xb, xc = np.int32(pb + kb), np.int32(pc + kc)
        tb = (f(max(eb, xb)) - pb) * rb if xb != eb else f(1)
        tc = (f(max(ec, xc)) - pc) * rc if xc != ec else f(1)
        mb, mc = (xb, ec) if tb < tc else (eb, xc)
        base = start + np.uint32(k) * sa
        t0, t1 = min(tb, tc), max(tb, tc)
        add_to(image, base + np.uint32(eb) * sb + np.uint32(ec) * sc, weight * t0)
        add_to(image, base + np.uint32(mb) * sb + np.uint32(mc) * sc, weight * (t1 - t0))
        add_to(image, base + np.uint32(xb) * sb + np.uint32(xc) * sc, weight * (f(1) - t1))


@nb.njit(parallel=True, cache=CACHE, error_model="numpy")
def adjoint(images, origin, voxel, views, cone, exact, out):
    """Add the exact adjoint of `forward` applied to ``images`` to ``out (nz, ny, nx)``."""
    nz, ny, nx = out.shape
    flat = out.reshape(-1)
    n, rows, columns = images.shape
    h = 1.0 / voxel
    for i in range(n):
        for axis in range(3):
            planes = nx if axis == 0 else (ny if axis == 1 else nz)
            size = (planes + CHUNKS - 1) // CHUNKS
            for chunk in nb.prange(CHUNKS):
                low, high = chunk * size, min(planes, (chunk + 1) * size)
                for r in range(rows):
                    for c in range(columns):
                        value = images[i, r, c]
                        if value == 0:
                            continue
                        px, py, pz, dx, dy, dz = pixel_ray(views[i], cone, r - (rows - 1) / 2, c - (columns - 1) / 2)
                        a, first, count, oa, ob, oc, da, db, dc, sa, sb, sc = enter(
                            (px - origin[0]) * h, (py - origin[1]) * h, (pz - origin[2]) * h,
                            dx * h, dy * h, dz * h, nx, ny, nz, exact,
                        )  # fmt: skip
                        last = min(first + count, high)
                        first = max(first, low)
                        if a != axis or last <= first:
                            continue
                        if exact:
                            scatter_exact(flat, value, first, last - first, oa, ob, oc, da, db, dc, sa, sb, sc)
                        else:
                            scatter_smooth(flat, value, first, last - first, oa, ob, oc, da, db, dc, sa, sb, sc)
