"""Projection of moving grains on the GPU, a ray a thread.

A block of threads takes some rows of a patch and runs along them, a thread a pixel: its rays stay close together,
and so do the voxels that they read.
"""

from __future__ import annotations

import math

from numba import cuda, float32

from grainmotion.kernels.cuda.device_array import SQUARE_PIXELS, TILE, download, on_gpu, square_grid
from grainmotion.kernels.cuda.grain_ray_tracing import gradients_at, value_at
from grainmotion.kernels.grain_projection import by_motion
from grainmotion.kernels.grain_ray_tracing import DIRECTIONS, FAR, along, narrowed, row_of_rays

SIDES = len(DIRECTIONS)


def project(grains, views, patches, exact, values):
    """Line integrals of every patch, to ``values`` on the GPU."""
    _launch(_project, grains, views, patches, exact, values)


def project_with_derivatives(grains, views, patches, exact, values, derivatives):
    """Line integrals and their derivatives ``(6, pixels)`` by u (mm) and δ (radians), on the GPU."""
    _launch(_project_with_derivatives, grains, views, patches, exact, values, derivatives)


def _launch(kernel, grains, views, patches, exact, *out):
    """Run a kernel over all runs of pixels."""
    count = len(patches.lines)
    if count:
        tables = (grains.starts, grains.shapes, grains.corners, grains.extents, grains.positions, grains.rotations,
                  views.vectors, patches.boxes, patches.offsets, patches.lines)  # fmt: skip
        kernel[-(-count // TILE[1]), TILE](
            on_gpu(grains.voxels), *(on_gpu(a) for a in tables), grains.voxel_size, views.cone,
            (views.panel[0] - 1) / 2, (views.panel[1] - 1) / 2, exact, *(a.array for a in out),
        )  # fmt: skip
    for array in out:
        array.changed()


def add_patches(values, patches, out):
    """Add patches on the GPU to the radiographs ``out (views, rows, columns)`` of the host.

    Every pixel adds its patches in their order, as on the CPU, so that the sum is the same.
    """
    if not len(patches.boxes):
        return
    image, tables = on_gpu(out), (patches.boxes, patches.offsets, patches.order, patches.view_starts)
    _gather[square_grid(out.shape), TILE](values.array, *(on_gpu(a) for a in tables), image)
    download(image, out)


@cuda.jit(device=True)
def _between(lines, extents, c):
    """The interval of t of the ray c columns from its row's first, with `along` of all directions."""
    low, high = float32(-FAR), float32(FAR)
    for j in range(SIDES):
        line = (lines[cuda.threadIdx.y, j, 0], lines[cuda.threadIdx.y, j, 1], lines[cuda.threadIdx.y, j, 2],
                lines[cuda.threadIdx.y, j, 3])  # fmt: skip
        low, high = narrowed(low, high, line, float32(c), float32(extents[0, j]), float32(extents[1, j]))
    return low, high


@cuda.jit
def _project(images, starts, shapes, corners, extents, positions, matrices, views, boxes, offsets, jobs, voxel, cone,
             middle_row, middle, exact, values):  # fmt: skip
    j = cuda.blockIdx.x * cuda.blockDim.y + cuda.threadIdx.y
    own = min(j, len(jobs) - 1)
    p, r, c0 = jobs[own, 0], jobs[own, 1], jobs[own, 2]
    g, i = boxes[p, 0], boxes[p, 1]
    o0, o1, d0, d1 = row_of_rays(views[i], cone, r - middle_row, positions[g], matrices[g], corners[g], 1.0 / voxel)
    lines = cuda.shared.array((TILE[1], SIDES, 4), float32)
    for k in range(cuda.threadIdx.x, SIDES, cuda.blockDim.x):
        line = along(k, o0, o1, d0, d1, c0 - middle)
        for n in range(4):
            lines[cuda.threadIdx.y, k, n] = line[n]
    cuda.syncthreads()
    if j >= len(jobs):
        return
    shape = shapes[g]
    image = images[starts[g] : starts[g] + shape[0] * shape[1] * shape[2]]
    at = offsets[p] + (r - boxes[p, 2]) * (boxes[p, 5] - boxes[p, 4]) - boxes[p, 4]
    for c in range(c0 + cuda.threadIdx.x, jobs[j, 3], cuda.blockDim.x):
        low, high = _between(lines, extents[g], c - c0)
        if low > high:
            values[at + c] = 0
            continue
        x = c - middle
        o = (o0[0] + x * o1[0], o0[1] + x * o1[1], o0[2] + x * o1[2])
        d = (d0[0] + x * d1[0], d0[1] + x * d1[1], d0[2] + x * d1[2])
        values[at + c] = value_at(image, shape, o, d, low, high, voxel, exact)


@cuda.jit
def _project_with_derivatives(images, starts, shapes, corners, extents, positions, matrices, views, boxes, offsets,
                              jobs, voxel, cone, middle_row, middle, exact, values, derivatives):  # fmt: skip
    j = cuda.blockIdx.x * cuda.blockDim.y + cuda.threadIdx.y
    own = min(j, len(jobs) - 1)
    p, r, c0 = jobs[own, 0], jobs[own, 1], jobs[own, 2]
    g, i = boxes[p, 0], boxes[p, 1]
    m, h = matrices[g], 1.0 / voxel
    corner = (corners[g, 0] * h, corners[g, 1] * h, corners[g, 2] * h)
    o0, o1, d0, d1 = row_of_rays(views[i], cone, r - middle_row, positions[g], m, corners[g], h)
    lines = cuda.shared.array((TILE[1], SIDES, 4), float32)
    for k in range(cuda.threadIdx.x, SIDES, cuda.blockDim.x):
        line = along(k, o0, o1, d0, d1, c0 - middle)
        for n in range(4):
            lines[cuda.threadIdx.y, k, n] = line[n]
    cuda.syncthreads()
    if j >= len(jobs):
        return
    shape = shapes[g]
    image = images[starts[g] : starts[g] + shape[0] * shape[1] * shape[2]]
    at = offsets[p] + (r - boxes[p, 2]) * (boxes[p, 5] - boxes[p, 4]) - boxes[p, 4]
    for c in range(c0 + cuda.threadIdx.x, jobs[j, 3], cuda.blockDim.x):
        low, high = _between(lines, extents[g], c - c0)
        if low > high:
            values[at + c] = 0
            for k in range(6):
                derivatives[k, at + c] = 0
            continue
        x = c - middle
        o = (o0[0] + x * o1[0], o0[1] + x * o1[1], o0[2] + x * o1[2])
        d = (d0[0] + x * d1[0], d0[1] + x * d1[1], d0[2] + x * d1[2])
        total, by_o, by_d = gradients_at(image, shape, o, d, low, high, exact)
        length = voxel * math.sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2])
        own = (o[0] + corner[0], o[1] + corner[1], o[2] + corner[2])
        by_shift, by_rotation = by_motion(own, d, by_o, by_d, m, -length)
        values[at + c] = length * total
        for n in range(3):
            derivatives[n, at + c] = h * by_shift[n]
            derivatives[3 + n, at + c] = by_rotation[n]


@cuda.jit
def _gather(values, boxes, offsets, order, first, out):
    i, top, left = cuda.blockIdx.z, cuda.blockIdx.y * SQUARE_PIXELS, cuda.blockIdx.x * SQUARE_PIXELS
    down, right = min(top + SQUARE_PIXELS, out.shape[1]), min(left + SQUARE_PIXELS, out.shape[2])
    for e in range(first[i], first[i + 1]):
        p = order[e]
        r0, r1, c0, c1 = boxes[p, 2], boxes[p, 3], boxes[p, 4], boxes[p, 5]
        if r0 < down and r1 > top and c0 < right and c1 > left:
            for r in range(top + cuda.threadIdx.y, down, cuda.blockDim.y):
                for c in range(left + cuda.threadIdx.x, right, cuda.blockDim.x):
                    if r0 <= r < r1 and c0 <= c < c1:
                        out[i, r, c] += values[offsets[p] + (r - r0) * (c1 - c0) + c - c0]
