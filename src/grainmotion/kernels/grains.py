"""Projection of moving grains, one patch of pixels a (grain, view), with derivatives by the six motions.

Rays are pulled back into each grain's own voxels: with y = p − c − u a point of the ray seen from the
moved centre and e its unit direction, both in the sample frame, the grain's frame has o = Ωᵀ y and
d = Ωᵀ e.  With G = Ω ∂I/∂o and H = Ω ∂I/∂d,

    ∂I/∂u = −G,      ∂I/∂δ = −(y × G + e × H)      for  Ω ← exp[δ]ₓ Ω.

p is taken nearest to the moved centre, which keeps single-precision sums short.

A patch is a row of ``boxes``: grain, view, first row, end row, first column, end column; its pixels lie
in row order in flat buffers from ``offsets[patch]``.  ``jobs`` lists the pixels to walk, (patch, row, first
column, end column), the unit of parallel work; other pixels of a patch are left as they are.

Grain g's voxels are ``images[starts[g]:]`` in C order with ``shapes[g]`` (z, y, x), voxel [0, 0, 0] at
``corners[g]`` (x y z, mm) from its centre c.
"""

from __future__ import annotations

import numba as nb

from grainmotion.kernels.rays import enter, exact_path, exact_value, pixel_ray, smooth_path, smooth_value


@nb.njit(cache=True, error_model="numpy")
def _pull_back(view, cone, row, column, position, matrix, corner, h):
    """Nearest point y to the moved centre and direction e (sample frame), then o, d in the grain's voxels."""
    px, py, pz, ex, ey, ez = pixel_ray(view, cone, row, column)
    yx, yy, yz = px - position[0], py - position[1], pz - position[2]
    back = yx * ex + yy * ey + yz * ez
    yx, yy, yz = yx - back * ex, yy - back * ey, yz - back * ez
    ox = matrix[0, 0] * yx + matrix[1, 0] * yy + matrix[2, 0] * yz
    oy = matrix[0, 1] * yx + matrix[1, 1] * yy + matrix[2, 1] * yz
    oz = matrix[0, 2] * yx + matrix[1, 2] * yy + matrix[2, 2] * yz
    dx = matrix[0, 0] * ex + matrix[1, 0] * ey + matrix[2, 0] * ez
    dy = matrix[0, 1] * ex + matrix[1, 1] * ey + matrix[2, 1] * ez
    dz = matrix[0, 2] * ex + matrix[1, 2] * ey + matrix[2, 2] * ez
    o = ((ox - corner[0]) * h, (oy - corner[1]) * h, (oz - corner[2]) * h)
    return (yx, yy, yz), (ex, ey, ez), o, (dx * h, dy * h, dz * h)


@nb.njit(parallel=True, cache=True, error_model="numpy")
def project(images, starts, shapes, corners, voxel, positions, matrices, views, cone, panel, boxes, offsets,
            jobs, exact, values):  # fmt: skip
    """Line integrals of every patch."""
    h = 1.0 / voxel
    for j in nb.prange(len(jobs)):
        p, r = jobs[j, 0], jobs[j, 1]
        g, i = boxes[p, 0], boxes[p, 1]
        nz, ny, nx = shapes[g, 0], shapes[g, 1], shapes[g, 2]
        image = images[starts[g] : starts[g] + nz * ny * nx]
        at = offsets[p] + (r - boxes[p, 2]) * (boxes[p, 5] - boxes[p, 4]) - boxes[p, 4]
        for c in range(jobs[j, 2], jobs[j, 3]):
            _, _, o, d = _pull_back(
                views[i], cone, r - (panel[0] - 1) / 2, c - (panel[1] - 1) / 2, positions[g], matrices[g],
                corners[g], h,
            )  # fmt: skip
            _, first, count, oa, ob, oc, da, db, dc, sa, sb, sc = enter(
                o[0], o[1], o[2], d[0], d[1], d[2], nx, ny, nz, exact
            )
            if count == 0:
                values[at + c] = 0
            elif exact:
                values[at + c] = exact_value(image, first, count, oa, ob, oc, da, db, dc, sa, sb, sc)
            else:
                values[at + c] = smooth_value(image, first, count, oa, ob, oc, da, db, dc, sa, sb, sc)


@nb.njit(parallel=True, cache=True, error_model="numpy")
def project_with_derivatives(images, starts, shapes, corners, voxel, positions, matrices, views, cone, panel,
                             boxes, offsets, jobs, exact, values, derivatives):  # fmt: skip
    """Line integrals and their derivatives ``(6, pixels)`` by u (mm) and δ (radians)."""
    h = 1.0 / voxel
    for j in nb.prange(len(jobs)):
        p, r = jobs[j, 0], jobs[j, 1]
        g, i = boxes[p, 0], boxes[p, 1]
        nz, ny, nx = shapes[g, 0], shapes[g, 1], shapes[g, 2]
        image = images[starts[g] : starts[g] + nz * ny * nx]
        m = matrices[g]
        at = offsets[p] + (r - boxes[p, 2]) * (boxes[p, 5] - boxes[p, 4]) - boxes[p, 4]
        for c in range(jobs[j, 2], jobs[j, 3]):
            y, e, o, d = _pull_back(
                views[i], cone, r - (panel[0] - 1) / 2, c - (panel[1] - 1) / 2, positions[g], m, corners[g], h
            )
            a, first, count, oa, ob, oc, da, db, dc, sa, sb, sc = enter(
                o[0], o[1], o[2], d[0], d[1], d[2], nx, ny, nz, exact
            )
            if count == 0:
                values[at + c] = 0
                for k in range(6):
                    derivatives[k, at + c] = 0
                continue
            if exact:
                total, gb, gc, hb, hc = exact_path(image, first, count, oa, ob, oc, da, db, dc, sa, sb, sc)
            else:
                total, gb, gc, hb, hc = smooth_path(image, first, count, oa, ob, oc, da, db, dc, sa, sb, sc)
            ga = -(gb * db + gc * dc) / da
            ha = -(total + hb * db + hc * dc) / da
            if a == 0:
                gx, gy, gz, hx, hy, hz = ga, gb, gc, ha, hb, hc
            elif a == 1:
                gx, gy, gz, hx, hy, hz = gb, ga, gc, hb, ha, hc
            else:
                gx, gy, gz, hx, hy, hz = gb, gc, ga, hb, hc, ha
            # ∂/∂ voxels → ∂/∂ mm, then to the sample frame.
            gx, gy, gz, hx, hy, hz = gx * h, gy * h, gz * h, hx * h, hy * h, hz * h
            tx = m[0, 0] * gx + m[0, 1] * gy + m[0, 2] * gz
            ty = m[1, 0] * gx + m[1, 1] * gy + m[1, 2] * gz
            tz = m[2, 0] * gx + m[2, 1] * gy + m[2, 2] * gz
            ux = m[0, 0] * hx + m[0, 1] * hy + m[0, 2] * hz
            uy = m[1, 0] * hx + m[1, 1] * hy + m[1, 2] * hz
            uz = m[2, 0] * hx + m[2, 1] * hy + m[2, 2] * hz
            values[at + c] = total
            derivatives[0, at + c] = -tx
            derivatives[1, at + c] = -ty
            derivatives[2, at + c] = -tz
            derivatives[3, at + c] = -(y[1] * tz - y[2] * ty + e[1] * uz - e[2] * uy)
            derivatives[4, at + c] = -(y[2] * tx - y[0] * tz + e[2] * ux - e[0] * uz)
            derivatives[5, at + c] = -(y[0] * ty - y[1] * tx + e[0] * uy - e[1] * ux)


@nb.njit(cache=True, error_model="numpy")
def add_patches(values, boxes, offsets, out):
    """Add patches to the radiographs ``out (views, rows, columns)``."""
    for p in range(len(boxes)):
        i, r0, r1, c0, c1 = boxes[p, 1], boxes[p, 2], boxes[p, 3], boxes[p, 4], boxes[p, 5]
        at = offsets[p]
        for r in range(r0, r1):
            for c in range(c0, c1):
                out[i, r, c] += values[at]
                at += 1
