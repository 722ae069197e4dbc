"""Whole volumes seen by upright panels: forward projection and its exact adjoint, column of pixels by column.

Where a panel's columns are parallel to z, all rays of a column cross a plane of the dominant axis a at one place of the
other horizontal axis b, and at heights that grow evenly with the row (`kernels.pixel_columns`).  A trilinear sample, or
the exact path through a slab of voxels, then parts in two: the two lines of voxels along z beside that place are
blended once for the whole column, and each ray takes its value from the blended line, neighbouring rays from
neighbouring voxels (`kernels.vertical_trilinear`).

A view crosses the whole volume, which is larger than any cache.  So the volume is taken tile by tile, each small enough
for the second cache, and all views at hand cross a tile before the next is taken.

The image is ``(ny, nx, nz)``, z fastest, and zero on its two outermost layers; ``origin`` is the position of voxel
[0, 0, 0] (x y z, mm), ``radius`` (voxels) that of the upright cylinder beyond which the image is zero, 0 for none.
The adjoint leaves the outermost layers, and voxels beyond the cylinder, undefined.  Forward, threads share the rays;
back, the tiles: no two write the same number, and every sum is taken in one order whatever their number.
"""

from __future__ import annotations

import numba as nb
import numpy as np

from grainmotion.kernels import vertical_exact, vertical_trilinear
from grainmotion.kernels.compilation import CACHE
from grainmotion.kernels.pixel_columns import column_rays, columns_across, lengths
from grainmotion.kernels.vertical_exact import path_slopes
from grainmotion.kernels.vertical_trilinear import LANES, LINE_MARGIN

TILE_EDGE = 24  # edge of a tile along x and y, voxels
TILE_ROWS = 256  # rows, and voxels along z, that a tile has about
MAX_VALUES = 1 << 24  # values of rays that are held at once, about
STRIPS_OF_A_THREAD = 4  # strips of columns, where there are fewer views than threads
_jit = nb.njit(cache=CACHE, error_model="numpy")


@nb.njit(parallel=True, cache=CACHE, error_model="numpy")
def forward(image, origin, voxel, views, cone, exact, radius, threads, out):
    """Line integrals ``out (views, rows, columns)`` of ``image``, by ``threads`` threads."""
    n, rows, columns = out.shape
    groups = min(n, threads)
    strips = 1 if groups == threads else STRIPS_OF_A_THREAD * (-(-threads // groups))
    tiles = max(1, (rows + TILE_ROWS // 2) // TILE_ROWS)
    for job in nb.prange(groups * strips):
        group, strip = job % groups, job // groups
        i0, i1 = group * n // groups, (group + 1) * n // groups
        c0, c1 = strip * columns // strips, (strip + 1) * columns // strips
        for tile in range(tiles):
            r0, r1 = tile * rows // tiles, (tile + 1) * rows // tiles
            batch = max(1, MAX_VALUES // max(1, (c1 - c0) * (r1 - r0)))
            for i in range(i0, i1, batch):
                part = i, min(i1, i + batch), c0, c1, r0, r1
                _forward_part(image, origin, voxel, views, cone, exact, radius, part, out)


@_jit
def _forward_part(image, origin, voxel, views, cone, exact, radius, part, out):
    """`forward` for the views i0 … i1 − 1, columns c0 … c1 − 1 and rows r0 … r1 − 1, the lowest counted 0."""
    ny, nx, nz = image.shape
    rows, columns = out.shape[1:]
    i0, i1, c0, c1, r0, r1 = part
    size = -(-(r1 - r0) // LANES) * LANES
    totals = np.zeros(((i1 - i0) * (c1 - c0), size), image.dtype)
    lines = np.zeros((2, nz + 2 * LINE_MARGIN), image.dtype)
    slopes = np.empty((3, size), image.dtype)
    h = 1.0 / voxel
    for y in range(0, ny, TILE_EDGE):
        for x in range(0, nx, TILE_EDGE):
            tile = x, min(nx, x + TILE_EDGE), y, min(ny, y + TILE_EDGE)
            for i in range(i0, i1):
                first, end = columns_across(views[i], cone, columns, origin, h, tile)
                for c in range(max(first, c0), min(end, c1)):
                    rays = column_rays(views[i], cone, c - (columns - 1) / 2, rows, origin, h)
                    total = totals[(i - i0) * (c1 - c0) + c - c0]
                    if exact:
                        path_slopes(rays, cone, r0, slopes)
                        vertical_exact.add_tile(image, rays, cone, radius, tile, (r0, r1), slopes, lines, total)
                    else:
                        vertical_trilinear.add_tile(image, rays, cone, radius, tile, (r0, r1), lines[0], total)
    length = np.empty(r1 - r0, image.dtype)
    for i in range(i0, i1):
        for c in range(c0, c1):
            rays = column_rays(views[i], cone, c - (columns - 1) / 2, rows, origin, h)
            lengths(rays, cone, voxel, r0, length)
            total = totals[(i - i0) * (c1 - c0) + c - c0]
            for r in range(r0, r1):
                out[i, r if views[i, 11] >= 0 else rows - 1 - r, c] = total[r - r0] * length[r - r0]


@nb.njit(parallel=True, cache=CACHE, error_model="numpy")
def adjoint(images, origin, voxel, views, cone, exact, radius, threads, out):
    """Add the exact adjoint of `forward` applied to ``images`` to ``out (ny, nx, nz)``."""
    ny, nx, nz = out.shape
    n, rows, columns = images.shape
    tiles_y, tiles_x, tiles_z = -(-ny // TILE_EDGE), -(-nx // TILE_EDGE), max(1, (nz + TILE_ROWS // 2) // TILE_ROWS)
    jobs = tiles_y * tiles_x * tiles_z
    batch = max(1, MAX_VALUES // max(1, rows * columns))
    values = np.empty((min(n, batch) * columns, rows + 2 * LINE_MARGIN), out.dtype)
    for i0 in range(0, n, batch):
        i1 = min(n, i0 + batch)
        for job in nb.prange((i1 - i0) * columns):
            i, c = i0 + job // columns, job % columns
            _weighted_column(images[i, :, c], origin, voxel, views[i], cone, c - (columns - 1) / 2, values[job])
        turns = -(-jobs // threads)
        for turn in nb.prange(turns * threads):
            job = turn % turns * threads + turn // turns  # a thread takes tiles of all parts of the volume
            if job < jobs:
                z, at = job % tiles_z, job // tiles_z
                y, x = at // tiles_x * TILE_EDGE, at % tiles_x * TILE_EDGE
                tile = x, min(nx, x + TILE_EDGE), y, min(ny, y + TILE_EDGE)
                part = i0, i1, z * nz // tiles_z, (z + 1) * nz // tiles_z
                _adjoint_tile(values, origin, voxel, views, cone, exact, radius, tile, part, (rows, columns), out)


@_jit
def _weighted_column(image, origin, voxel, view, cone, column, out):
    """A column's values times the lengths of its rays between two planes, the lowest row first, zeros around."""
    rows = len(image)
    rays = column_rays(view, cone, column, rows, origin, 1.0 / voxel)
    out[:LINE_MARGIN] = 0
    out[LINE_MARGIN + rows :] = 0
    inner = out[LINE_MARGIN : LINE_MARGIN + rows]
    lengths(rays, cone, voxel, 0, inner)
    for r in range(rows):
        inner[r] *= image[r if view[11] >= 0 else rows - 1 - r]


@_jit
def _adjoint_tile(values, origin, voxel, views, cone, exact, radius, tile, part, panel, out):
    """Add the adjoint of the views i0 … i1 − 1 to the voxels z0 … z1 − 1 of a tile."""
    i0, i1, z0, z1 = part
    rows, columns = panel
    h = 1.0 / voxel
    lines = np.empty((2, out.shape[2] + 2 * LINE_MARGIN), out.dtype)
    slopes = np.empty((3, values.shape[1]), out.dtype)
    for i in range(i0, i1):
        first, end = columns_across(views[i], cone, columns, origin, h, tile)
        for c in range(first, end):
            rays = column_rays(views[i], cone, c - (columns - 1) / 2, rows, origin, h)
            given = values[(i - i0) * columns + c]
            if exact:
                path_slopes(rays, cone, -LINE_MARGIN, slopes)
                vertical_exact.spread_tile(given, rows, rays, cone, radius, tile, (z0, z1), slopes, lines, out)
            else:
                vertical_trilinear.spread_tile(given, rows, rays, cone, radius, tile, (z0, z1), lines[0], out)
