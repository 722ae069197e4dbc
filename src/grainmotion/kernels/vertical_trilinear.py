"""Trilinear samples of a column of rays on one plane, and their adjoint, sixteen neighbours at a time.

Ray r crosses a plane at height start + r · step of the line of voxels along z that the column meets there.  With
voxels about as high as pixels the step is nearly 1, and sixteen neighbouring rays sample little more than seventeen
neighbouring voxels: ray r lies at u(r) = start + r · step − (r + n) above voxel r + n, for the largest whole n that
leaves u ≥ 0, and linear interpolation over the voxels r + n, r + n + 1, … is

    v(r + n) + Σ_j clamp(u(r) − j, 0, 1) · (v(r + n + j + 1) − v(r + n + j)),    j = 0 … max u

where neighbouring rays read neighbouring voxels.  The adjoint takes the same view from the voxels: the rays r for which
voxel z counts, with weight 1 − |start + r · step − z| > 0, are z + n, z + n + 1, ….
"""

from __future__ import annotations

import math

import numba as nb

from grainmotion.kernels.compilation import CACHE
from grainmotion.kernels.pixel_columns import axes, heights, reach
from grainmotion.kernels.vector_functions import absolute, counted, maximum, minimum, spread
from grainmotion.kernels.vector_memory import loaded, prefetch, stored

LANES = 16  # neighbouring rays or voxels that are computed at once
LINE_MARGIN = 64  # values beside a line of voxels that blocks of rays may read; enough for steps up to 4
PLANES_AHEAD = 4  # planes before its use that a line of voxels is asked for from memory
FRACTION = 40  # binary places of heights as whole numbers, which are quicker to split in whole and rest
ONE = 1 << FRACTION
_jit = nb.njit(cache=CACHE, error_model="numpy")


@_jit
def fixed(height):
    """A height in units of 2^-`FRACTION` voxels."""
    return math.floor(height * ONE + 0.5)


@_jit
def blend(image, near, far, weight, low, high, line):
    """Voxels low … high − 1 between two lines of a flat image, which start at ``near`` and ``far``."""
    if high - low < LANES:
        for z in range(low, high):
            line[LINE_MARGIN + z] = image[near + z] + weight * (image[far + z] - image[near + z])
        return
    z = low
    while True:
        values = loaded(image, near + z, LANES)
        stored(line, LINE_MARGIN + z, weight * (loaded(image, far + z, LANES) - values) + values)
        if z == high - LANES:
            break
        z = min(z + LANES, high - LANES)


@_jit
def add_samples(line, voxels, start, step, total):
    """Add the line of ``voxels`` at height start + r · step to ``total[r]``."""
    f = total.dtype.type
    unit = spread(f(1.0 / ONE), LANES)
    slope = fixed(step) - ONE
    across = counted(f(0), LANES) * (f(slope) * unit)
    rise = (LANES - 1) * slope
    taps = 2 + (abs(rise) >> FRACTION)
    place, one_block = fixed(start) + min(rise, 0), LANES * slope
    low, high = -(LANES + taps), voxels - 1
    if slope < 0:
        across = across - f(rise) * unit
    for r in range(0, len(total), LANES):
        lowest = place >> FRACTION
        at = r + lowest
        if low <= at <= high:
            u = f(place - (lowest << FRACTION)) * unit + across
            values = loaded(line, LINE_MARGIN + at, LANES)
            if taps == 2:  # nearly always
                middle = loaded(line, LINE_MARGIN + at + 1, LANES)
                sums = minimum(u, 1.0) * (middle - values) + values
                sums = maximum(u - 1.0, 0.0) * (loaded(line, LINE_MARGIN + at + 2, LANES) - middle) + sums
            else:
                sums = values
                for j in range(1, taps + 1):
                    above = loaded(line, LINE_MARGIN + at + j, LANES)
                    sums = minimum(maximum(u, 0.0), 1.0) * (above - values) + sums
                    u = u - 1.0
                    values = above
            stored(total, r, loaded(total, r, LANES) + sums)
        place += one_block


@_jit
def collect(rays, rows, start, step, low, high, line):
    """The adjoint of `add_samples`: voxels low … high − 1 of a line from values ``rays[LINE_MARGIN + r]``."""
    f = line.dtype.type
    unit = spread(f(1.0 / ONE), LANES)
    from_start, per_row = fixed(start), fixed(step)
    across, one_step = counted(f(0), LANES) * (f(per_row - ONE) * unit), f(step)
    rise = (LANES - 1) * (step - 1.0)
    reach_down, reach = 1.0 + max(rise, 0.0), 2.0 + abs(rise)
    taps = math.ceil(reach / step)
    row, one_block = fixed((low - reach_down - start) / step), fixed(LANES / step)
    for z in range(low, high, LANES):
        first = max(1 - LANES, min(rows, (row >> FRACTION) + 1))
        row += one_block
        above = f(from_start + first * per_row - (z << FRACTION)) * unit + across
        at = LINE_MARGIN + first
        if taps <= 4:  # nearly always
            second = above + one_step
            third = second + one_step
            sums = maximum(1.0 - absolute(above), 0.0) * loaded(rays, at, LANES)
            more = maximum(1.0 - absolute(second), 0.0) * loaded(rays, at + 1, LANES)
            sums = maximum(1.0 - absolute(third), 0.0) * loaded(rays, at + 2, LANES) + sums
            if taps == 4:
                more = maximum(1.0 - absolute(third + one_step), 0.0) * loaded(rays, at + 3, LANES) + more
            sums = sums + more
        else:
            sums = spread(f(0), LANES)
            for r in range(at, min(at + taps, LINE_MARGIN + rows)):
                sums = maximum(1.0 - absolute(above), 0.0) * loaded(rays, r, LANES) + sums
                above = above + one_step
        stored(line, LINE_MARGIN + z, sums)


@_jit
def expect(image, at, low, high):
    """Tell the processor that voxels low … high − 1 of the line that starts at ``at`` are read soon."""
    for z in range(low, high, LANES):
        prefetch(image, at + z)


@_jit
def add_line(line, weight, low, high, image, at):
    """Add a line's voxels low … high − 1, times a weight, to those of a flat image from ``at`` on."""
    z = low
    while z + LANES <= high:
        stored(image, at + z, weight * loaded(line, LINE_MARGIN + z, LANES) + loaded(image, at + z, LANES))
        z += LANES
    while z < high:
        image[at + z] += weight * line[LINE_MARGIN + z]
        z += 1


@_jit
def add_tile(image, rays, cone, radius, tile, rows, line, total):
    """Add the samples of a column's rays, of the rows first … end − 1, in a tile to ``total``."""
    nz = image.shape[2]
    flat = image.reshape(-1)
    _, sa, sb, _, da, db, _, _ = rays
    slope = db / da
    first, end, b0, b1, stride_a, stride_b = axes(rays, tile, image.shape, radius, 0.0)
    for k in range(first, end):
        b = sb + (k - sa) * slope
        at = int(b)
        if at < b0 or at >= b1:
            continue
        start, step = heights(rays, cone, k)
        start += rows[0] * step
        low, high = reach(start, step, rows[1] - rows[0], 0, nz)
        if low < high:
            near = k * stride_a + at * stride_b
            ahead = (k + PLANES_AHEAD) * stride_a + int(b + PLANES_AHEAD * slope) * stride_b
            expect(flat, ahead, low, high)
            expect(flat, ahead + stride_b, low, high)
            blend(flat, near, near + stride_b, image.dtype.type(b - at), low, high, line)
            add_samples(line, nz, start, step, total)


@_jit
def spread_tile(values, rows, rays, cone, radius, tile, span, line, out):
    """The adjoint of `add_tile` for the voxels z0 … z1 − 1 (``span``) of a tile; ``values`` as in `collect`."""
    f = out.dtype.type
    flat = out.reshape(-1)
    _, sa, sb, _, da, db, _, _ = rays
    slope = db / da
    first, end, b0, b1, stride_a, stride_b = axes(rays, tile, out.shape, radius, 0.0)
    for k in range(first, end):
        b = sb + (k - sa) * slope
        at = int(b)
        if at < b0 - 1 or at >= b1:
            continue
        start, step = heights(rays, cone, k)
        low, high = reach(start, step, rows, span[0], span[1])
        if low < high:
            near, weight = k * stride_a + at * stride_b, f(b - at)
            ahead = (k + PLANES_AHEAD) * stride_a + int(b + PLANES_AHEAD * slope) * stride_b
            expect(flat, ahead, low, high)
            expect(flat, ahead + stride_b, low, high)
            collect(values, rows, start, step, low, high, line)
            if at >= b0:
                add_line(line, f(1) - weight, low, high, flat, near)
            if at + 1 < b1:
                add_line(line, weight, low, high, flat, near + stride_b)
