"""Products with J and blocks of JᵀJ on the GPU; see `kernels.normal_equations`.

Sums over pixels are taken in double precision, a thread's share first and then over the threads by a tree, so that
they are the same in every run.
"""

from __future__ import annotations

import numpy as np
from numba import cuda, float64

from grainmotion.kernels.cuda.device_array import SQUARE_PIXELS, THREADS, TILE, download, empty, on_gpu, square_grid


def vjp(derivatives, patches, images, out):
    """Jᵀ y: dot products ``out (patches, 6)`` of patches on the GPU with ``images (views, rows, columns)``."""
    if len(patches.boxes):
        dots = empty(out.shape, np.float64).array
        tables = on_gpu(patches.boxes), on_gpu(patches.offsets)
        _vjp[len(patches.boxes), TILE](derivatives.array, *tables, on_gpu(images), dots)
        download(dots, out)


def gram_blocks(derivatives, patches, pairs, first, out):
    """6×6 blocks ``out (blocks, 6, 6)`` of JᵀJ, of patches on the GPU."""
    if len(out):
        blocks = empty(out.shape, np.float64).array
        tables = on_gpu(patches.boxes), on_gpu(patches.offsets), on_gpu(pairs), on_gpu(first)
        _gram_blocks[len(out), TILE](derivatives.array, *tables, blocks)
        download(blocks, out)


def jvp(derivatives, patches, increments, images):
    """J x: fill ``images (views, rows, columns)``, on the GPU, with what ``increments (n, 6)`` change in all patches.

    The patches of a view are added in the order of the table.
    """
    tables = patches.boxes, patches.offsets, patches.order, patches.view_starts, increments
    _jvp[square_grid(images.shape), TILE](derivatives.array, *(on_gpu(a) for a in tables), images.array)
    images.changed()


@cuda.jit
def _jvp(derivatives, boxes, offsets, order, first, increments, out):
    i, top, left = cuda.blockIdx.z, cuda.blockIdx.y * SQUARE_PIXELS, cuda.blockIdx.x * SQUARE_PIXELS
    down, right = min(top + SQUARE_PIXELS, out.shape[1]), min(left + SQUARE_PIXELS, out.shape[2])
    f = out.dtype.type
    for r in range(top + cuda.threadIdx.y, down, cuda.blockDim.y):
        for c in range(left + cuda.threadIdx.x, right, cuda.blockDim.x):
            out[i, r, c] = 0
    for e in range(first[i], first[i + 1]):
        p = order[e]
        g, r0, r1, c0, c1 = boxes[p, 0], boxes[p, 2], boxes[p, 3], boxes[p, 4], boxes[p, 5]
        if r0 < down and r1 > top and c0 < right and c1 > left:
            v0, v1, v2 = f(increments[g, 0]), f(increments[g, 1]), f(increments[g, 2])
            v3, v4, v5 = f(increments[g, 3]), f(increments[g, 4]), f(increments[g, 5])
            for r in range(top + cuda.threadIdx.y, down, cuda.blockDim.y):
                for c in range(left + cuda.threadIdx.x, right, cuda.blockDim.x):
                    if r0 <= r < r1 and c0 <= c < c1:
                        at = offsets[p] + (r - r0) * (c1 - c0) + c - c0
                        by_shift = v0 * derivatives[0, at] + v1 * derivatives[1, at] + v2 * derivatives[2, at]
                        by_rotation = v3 * derivatives[3, at] + v4 * derivatives[4, at] + v5 * derivatives[5, at]
                        out[i, r, c] += by_shift + by_rotation


@cuda.jit(device=True)
def _add_up(parts, count):
    """Sums of the rows ``parts (count, THREADS)`` in their first column."""
    me = cuda.threadIdx.y * cuda.blockDim.x + cuda.threadIdx.x
    cuda.syncthreads()
    half = THREADS // 2
    while half > 0:
        if me < half:
            for k in range(count):
                parts[k, me] += parts[k, me + half]
        cuda.syncthreads()
        half //= 2


@cuda.jit
def _vjp(derivatives, boxes, offsets, images, out):
    p = cuda.blockIdx.x
    i, r0, c0 = boxes[p, 1], boxes[p, 2], boxes[p, 4]
    rows, columns = boxes[p, 3] - r0, boxes[p, 5] - c0
    sums = cuda.local.array(6, float64)
    for k in range(6):
        sums[k] = 0
    for r in range(cuda.threadIdx.y, rows, cuda.blockDim.y):
        for c in range(cuda.threadIdx.x, columns, cuda.blockDim.x):
            value = float64(images[i, r0 + r, c0 + c])
            at = offsets[p] + r * columns + c
            for k in range(6):
                sums[k] += derivatives[k, at] * value
    parts = cuda.shared.array((6, THREADS), float64)
    me = cuda.threadIdx.y * cuda.blockDim.x + cuda.threadIdx.x
    for k in range(6):
        parts[k, me] = sums[k]
    _add_up(parts, 6)
    for k in range(me, 6, THREADS):
        out[p, k] = parts[k, 0]


@cuda.jit
def _gram_blocks(derivatives, boxes, offsets, pairs, first, out):
    q = cuda.blockIdx.x
    sums, left, right = cuda.local.array(36, float64), cuda.local.array(6, float64), cuda.local.array(6, float64)
    for k in range(36):
        sums[k] = 0
    for e in range(first[q], first[q + 1]):
        p, t = pairs[e, 0], pairs[e, 1]
        r0, r1 = max(boxes[p, 2], boxes[t, 2]), min(boxes[p, 3], boxes[t, 3])
        c0, c1 = max(boxes[p, 4], boxes[t, 4]), min(boxes[p, 5], boxes[t, 5])
        wide_p, wide_t = boxes[p, 5] - boxes[p, 4], boxes[t, 5] - boxes[t, 4]
        for r in range(r0 + cuda.threadIdx.y, r1, cuda.blockDim.y):
            row_p = offsets[p] + (r - boxes[p, 2]) * wide_p - boxes[p, 4]
            row_t = offsets[t] + (r - boxes[t, 2]) * wide_t - boxes[t, 4]
            for c in range(c0 + cuda.threadIdx.x, c1, cuda.blockDim.x):
                for k in range(6):
                    left[k], right[k] = derivatives[k, row_p + c], derivatives[k, row_t + c]
                for k in range(6):
                    for m in range(6):
                        sums[6 * k + m] += left[k] * right[m]
    parts = cuda.shared.array((36, THREADS), float64)
    me = cuda.threadIdx.y * cuda.blockDim.x + cuda.threadIdx.x
    for k in range(36):
        parts[k, me] = sums[k]
    _add_up(parts, 36)
    for k in range(me, 36, THREADS):
        out[q, k // 6, k % 6] = parts[k, 0]
