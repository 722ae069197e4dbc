"""Filters and normal equations on the card; see `kernels.normal_equations`.

Sums over pixels are taken in double precision, a thread's share first and then over the threads by a tree, so that
they are the same in every run.
"""

from __future__ import annotations

import numpy as np
from numba import cuda, float64

from grainmotion.kernels.cuda.device_array import MOST, SQUARE, THREADS, TILE, bring, empty, on_card, squares


def filter_images(images, weights):
    """Filter ``images (n, rows, columns)`` of the host in place."""
    n, rows, columns = images.shape
    if not images.size:
        return
    image, work, kernel = on_card(images), empty(images.shape, images.dtype).array, on_card(weights)
    grid = (min(-(-columns // TILE[0]), MOST), min(-(-rows // TILE[1]), MOST), n)
    _along_rows[grid, TILE](image, work, kernel)
    _along_columns[grid, TILE](work, image, kernel)
    bring(image, images)


def filter_patches(derivatives, boxes, offsets, valid, weights):
    """Mask, then filter each patch of ``derivatives (k, pixels)``, held on the card, in place."""
    each, pixels = derivatives.shape
    if pixels:
        where = on_card(boxes), on_card(offsets), on_card(valid), on_card(weights)
        work = empty((each, pixels if len(weights) > 1 else 1), derivatives.dtype)
        _filter_patches[(len(boxes), each), TILE](derivatives.array, work.array, *where)
    derivatives.changed()


def gradients(derivatives, boxes, offsets, images, out):
    """Dot products ``out (patches, 6)`` of patches held on the card with ``images (views, rows, columns)``."""
    if not len(boxes):
        return
    found = empty(out.shape, np.float64).array
    _gradients[len(boxes), TILE](
        derivatives.array,
        on_card(boxes),
        on_card(offsets),
        on_card(images),
        found,
    )
    bring(found, out)


def blocks(derivatives, boxes, offsets, pairs, first, out):
    """6×6 blocks ``out (blocks, 6, 6)`` of JᵀJ, of patches held on the card."""
    if not len(out):
        return
    found = empty(out.shape, np.float64).array
    where = on_card(boxes), on_card(offsets), on_card(pairs), on_card(first)
    _blocks[len(out), TILE](derivatives.array, *where, found)
    bring(found, out)


def spread(derivatives, boxes, offsets, order, first, increments, images):
    """Fill ``images (views, rows, columns)``, held on the card, with what ``increments (n, 6)`` change in all patches.

    ``order[first[i]:first[i + 1]]`` are the patches of view i, whose shares are added in this order.
    """
    tables = [on_card(a) for a in (boxes, offsets, order, first, increments)]
    _spread[squares(images.shape), TILE](derivatives.array, *tables, images.array)
    images.changed()


@cuda.jit
def _along_rows(image, out, weights):
    left, top = cuda.grid(2)
    right, down = cuda.gridsize(2)
    i, reach = cuda.blockIdx.z, len(weights) - 1
    for r in range(top, image.shape[1], down):
        for c in range(left, image.shape[2], right):
            total = weights[0] * image[i, r, c]
            for k in range(1, reach + 1):
                if c >= k:
                    total += weights[k] * image[i, r, c - k]
                if c + k < image.shape[2]:
                    total += weights[k] * image[i, r, c + k]
            out[i, r, c] = total


@cuda.jit
def _along_columns(image, out, weights):
    left, top = cuda.grid(2)
    right, down = cuda.gridsize(2)
    i, reach = cuda.blockIdx.z, len(weights) - 1
    for r in range(top, image.shape[1], down):
        for c in range(left, image.shape[2], right):
            total = weights[0] * image[i, r, c]
            for k in range(1, reach + 1):
                if r >= k:
                    total += weights[k] * image[i, r - k, c]
                if r + k < image.shape[1]:
                    total += weights[k] * image[i, r + k, c]
            out[i, r, c] = total


@cuda.jit
def _filter_patches(derivatives, work, boxes, offsets, valid, weights):
    """One patch of one derivative a block: masked, then along its rows to ``work``, then along its columns."""
    p, each = cuda.blockIdx.x, cuda.blockIdx.y
    i, r0, c0 = boxes[p, 1], boxes[p, 2], boxes[p, 4]
    rows, columns = boxes[p, 3] - r0, boxes[p, 5] - c0
    reach, start = len(weights) - 1, offsets[p]
    for r in range(cuda.threadIdx.y, rows, cuda.blockDim.y):
        for c in range(cuda.threadIdx.x, columns, cuda.blockDim.x):
            derivatives[each, start + r * columns + c] *= valid[i, r0 + r, c0 + c]
    if reach == 0:
        return
    cuda.syncthreads()
    for r in range(cuda.threadIdx.y, rows, cuda.blockDim.y):
        row = start + r * columns
        for c in range(cuda.threadIdx.x, columns, cuda.blockDim.x):
            total = weights[0] * derivatives[each, row + c]
            for k in range(1, reach + 1):
                if c >= k:
                    total += weights[k] * derivatives[each, row + c - k]
                if c + k < columns:
                    total += weights[k] * derivatives[each, row + c + k]
            work[each, row + c] = total
    cuda.syncthreads()
    for r in range(cuda.threadIdx.y, rows, cuda.blockDim.y):
        for c in range(cuda.threadIdx.x, columns, cuda.blockDim.x):
            at = start + r * columns + c
            total = weights[0] * work[each, at]
            for k in range(1, reach + 1):
                if r >= k:
                    total += weights[k] * work[each, at - k * columns]
                if r + k < rows:
                    total += weights[k] * work[each, at + k * columns]
            derivatives[each, at] = total


@cuda.jit
def _spread(derivatives, boxes, offsets, order, first, increments, out):
    i, top, left = cuda.blockIdx.z, cuda.blockIdx.y * SQUARE, cuda.blockIdx.x * SQUARE
    down, right = min(top + SQUARE, out.shape[1]), min(left + SQUARE, out.shape[2])
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
                        shift = v0 * derivatives[0, at] + v1 * derivatives[1, at] + v2 * derivatives[2, at]
                        turn = v3 * derivatives[3, at] + v4 * derivatives[4, at] + v5 * derivatives[5, at]
                        out[i, r, c] += shift + turn


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
def _gradients(derivatives, boxes, offsets, images, out):
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
def _blocks(derivatives, boxes, offsets, pairs, first, out):
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
