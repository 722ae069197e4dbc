"""Exact paths of a column of rays through one slab of voxels, and their adjoint, sixteen neighbours at a time.

Slab k spans k − ½ … k + ½ of the dominant axis a.  All rays of a column cross the border between two lines of voxels
along z, A where they enter and B where they leave, at one fraction s of the slab (1 if they stay in A).  With t the
fraction at which a ray rises through the border below voxel n, what of the slab lies in voxels n and above is

    a(t) = max(s − t, 0) in A,    b(t) = min(1 − t, 1 − s) in B

and the mean along the ray is s A + (1 − s) B at its lowest voxel, plus Σ_n a(t) (A_n − A_n−1) + b(t) (B_n − B_n−1)
over the borders that it crosses; where it falls, s − a(t) and 1 − s − b(t) take their place.  Few rays cross a border,
but neighbours do it at neighbouring places, so that all sixteen take the same few steps (see `vertical_trilinear`).
"""

from __future__ import annotations

import math

import numba as nb

from grainmotion.kernels.compilation import CACHE
from grainmotion.kernels.pixel_columns import axes, heights, reach
from grainmotion.kernels.vector_functions import counted, maximum, minimum, spread
from grainmotion.kernels.vector_memory import loaded, stored
from grainmotion.kernels.vertical_trilinear import FRACTION, LANES, LINE_MARGIN, ONE, add_line, fixed

LEVEL_SLOPE, LEAST_SLOPE = 1e-10, 1e-15  # a ray along z that rises or falls less is level: it rises by the second
BORDER_TO_CENTER = (
    0.5 + 2.0**-30
)  # from a voxel's border to its centre; a ray along a border counts above it despite rounding
_jit = nb.njit(cache=CACHE, error_model="numpy")


@_jit
def path_slopes(rays, cone, first, slopes):
    """For rows ``first …``: a's change per voxel of height, 1 where a ray rises and −1 where it falls, 0 and 1."""
    _, _, _, _, da, _, dz, vz = rays
    for r in range(slopes.shape[1]):
        slope = (dz + (first + r) * vz if cone else dz) / da
        if abs(slope) < LEVEL_SLOPE:
            slope = LEAST_SLOPE
        slopes[0, r] = 1.0 / slope
        slopes[1, r] = 1.0 if slope > 0 else -1.0
        slopes[2, r] = 0.0 if slope > 0 else 1.0


@_jit
def crossing(b, slope):
    """Lines in which a column enters and leaves a slab, and the fraction of it at which the line changes."""
    enter, leave = int(b), int(b + slope)
    return enter, leave, (max(enter, leave) - b) / slope if leave != enter else 1.0


@_jit
def copy_line(image, at, low, high, line):
    """Voxels low … high − 1 of the line of a flat image that starts at ``at``."""
    for z in range(low, high):
        line[LINE_MARGIN + z] = image[at + z]


@_jit
def add_paths(lines, voxels, share, enter, leave, first, slopes, total):
    """Add the means of the rays ``first …`` in a slab to ``total``: ``lines`` are A and B, ``share`` is s.

    ``enter`` and ``leave`` are the height, counted from the lower border of voxel 0, at which ray 0 crosses the slab's
    faces, and what each next ray adds.
    """
    f = total.dtype.type
    a_line, b_line = lines[0], lines[1]
    unit = spread(f(1.0 / ONE), LANES)
    part, rest = spread(f(share), LANES), spread(f(1) - f(share), LANES)
    p0, s0 = fixed(enter[0]) + first * fixed(enter[1]), fixed(enter[1]) - ONE
    p1, s1 = fixed(leave[0]) + first * fixed(leave[1]), fixed(leave[1]) - ONE
    across = counted(f(0), LANES) * (f(s0) * unit)
    e0, e1 = (LANES - 1) * s0, (LANES - 1) * s1
    for r in range(0, len(total), LANES):
        least = min(min(p0, p0 + e0), min(p1, p1 + e1))
        most = max(max(p0, p0 + e0), max(p1, p1 + e1))
        lowest = least >> FRACTION
        borders = 1 + ((most - least) >> FRACTION)
        at = r + lowest
        if at + LANES + borders >= 0 and at < voxels:
            at += LINE_MARGIN
            per_height, sign = loaded(slopes[0], r, LANES), loaded(slopes[1], r, LANES)
            falls = loaded(slopes[2], r, LANES)
            t = (1.0 - (f(p0 - (lowest << FRACTION)) * unit + across)) * per_height
            a = loaded(a_line, at, LANES)
            if share == 1.0:
                sums = a
                for j in range(1, borders + 1):
                    a_above = loaded(a_line, at + j, LANES)
                    in_a = sign * (1.0 - minimum(maximum(t, 0.0), 1.0)) + falls
                    sums = in_a * (a_above - a) + sums
                    t = t + per_height
                    a = a_above
            else:
                b = loaded(b_line, at, LANES)
                sums = part * a + rest * b
                falls_a, falls_b = falls * part, falls * rest
                for j in range(1, borders + 1):
                    a_above, b_above = loaded(a_line, at + j, LANES), loaded(b_line, at + j, LANES)
                    place = minimum(maximum(t, 0.0), 1.0)
                    in_a = sign * maximum(part - place, 0.0) + falls_a
                    in_b = sign * minimum(1.0 - place, rest) + falls_b
                    sums = in_a * (a_above - a) + sums
                    sums = in_b * (b_above - b) + sums
                    t = t + per_height
                    a, b = a_above, b_above
            stored(total, r, loaded(total, r, LANES) + sums)
        p0 += LANES * s0
        p1 += LANES * s1


@_jit
def collect_paths(rays, rows, share, enter, leave, slopes, span, lines):
    """The adjoint of `add_paths`: voxels low … high − 1 (``span``) of lines A and B from ``rays[LINE_MARGIN + r]``.

    ``slopes`` are those of the rays, in the same places.
    """
    f = lines.dtype.type
    a_line, b_line = lines[0], lines[1]
    unit = spread(f(1.0 / ONE), LANES)
    part, rest = spread(f(share), LANES), spread(f(1) - f(share), LANES)
    p0, s0 = fixed(enter[0]), fixed(enter[1])
    across, one_step = counted(f(0), LANES) * (f(s0 - ONE) * unit), f(enter[1])
    up = (LANES - 1) * max(max(enter[1], leave[1]) - 1.0, 0.0)
    down = (LANES - 1) * min(min(enter[1], leave[1]) - 1.0, 0.0)
    for z in range(span[0], span[1], LANES):
        first = min(math.floor((z - up - enter[0]) / enter[1]), math.floor((z - up - leave[0]) / leave[1]))
        last = max(math.ceil((z + 1 - down - enter[0]) / enter[1]), math.ceil((z + 1 - down - leave[0]) / leave[1]))
        first, last = max(1 - LANES, first), min(rows - 1, last)
        below = f(p0 + first * s0 - (z << FRACTION)) * unit + across
        in_a, in_b = spread(f(0), LANES), spread(f(0), LANES)
        for r in range(LINE_MARGIN + first, LINE_MARGIN + last + 1):
            per_height = loaded(slopes[0], r, LANES)
            t = 0.0 - below * per_height
            low = minimum(maximum(t, 0.0), 1.0)
            high = minimum(maximum(t + per_height, 0.0), 1.0)
            value = loaded(slopes[1], r, LANES) * loaded(rays, r, LANES)
            in_a = (maximum(part - low, 0.0) - maximum(part - high, 0.0)) * value + in_a
            in_b = (minimum(1.0 - low, rest) - minimum(1.0 - high, rest)) * value + in_b
            below = below + one_step
        stored(a_line, LINE_MARGIN + z, in_a)
        stored(b_line, LINE_MARGIN + z, in_b)


@_jit
def add_tile(image, rays, cone, radius, tile, rows, slopes, lines, total):
    """Add the paths of a column's rays, of the rows first … end − 1, through a tile to ``total``."""
    nz, count = image.shape[2], rows[1] - rows[0]
    flat = image.reshape(-1)
    _, sa, sb, _, da, db, _, _ = rays
    slope = db / da
    first, end, b0, b1, stride_a, stride_b = axes(rays, tile, image.shape, radius, 0.5)
    for k in range(first, end):
        in_a, in_b, share = crossing(sb + BORDER_TO_CENTER + (k - 0.5 - sa) * slope, slope)
        if in_a < b0 or in_a >= b1:
            continue
        start0, step0 = heights(rays, cone, k - 0.5)
        start1, step1 = heights(rays, cone, k + 0.5)
        start0, start1 = start0 + BORDER_TO_CENTER, start1 + BORDER_TO_CENTER
        low0, high0 = reach(start0 + rows[0] * step0, step0, count, 0, nz)
        low1, high1 = reach(start1 + rows[0] * step1, step1, count, 0, nz)
        low, high = min(low0, low1), max(high0, high1)
        if low < high:
            copy_line(flat, k * stride_a + in_a * stride_b, low, high, lines[0])
            if in_b != in_a:
                copy_line(flat, k * stride_a + in_b * stride_b, low, high, lines[1])
            add_paths(lines, nz, share, (start0, step0), (start1, step1), rows[0], slopes, total)


@_jit
def spread_tile(values, rows, rays, cone, radius, tile, span, slopes, lines, out):
    """The adjoint of `add_tile` for the voxels z0 … z1 − 1 (``span``) of a tile; values and slopes: `collect_paths`."""
    one = out.dtype.type(1)
    flat = out.reshape(-1)
    _, sa, sb, _, da, db, _, _ = rays
    slope = db / da
    first, end, b0, b1, stride_a, stride_b = axes(rays, tile, out.shape, radius, 0.5)
    for k in range(first, end):
        in_a, in_b, share = crossing(sb + BORDER_TO_CENTER + (k - 0.5 - sa) * slope, slope)
        if max(in_a, in_b) < b0 or min(in_a, in_b) >= b1:
            continue
        start0, step0 = heights(rays, cone, k - 0.5)
        start1, step1 = heights(rays, cone, k + 0.5)
        start0, start1 = start0 + BORDER_TO_CENTER, start1 + BORDER_TO_CENTER
        low0, high0 = reach(start0, step0, rows, span[0], span[1])
        low1, high1 = reach(start1, step1, rows, span[0], span[1])
        low, high = min(low0, low1), max(high0, high1)
        if low < high:
            collect_paths(values, rows, share, (start0, step0), (start1, step1), slopes, (low, high), lines)
            if b0 <= in_a < b1:
                add_line(lines[0], one, low, high, flat, k * stride_a + in_a * stride_b)
            if in_b != in_a and b0 <= in_b < b1:
                add_line(lines[1], one, low, high, flat, k * stride_a + in_b * stride_b)
