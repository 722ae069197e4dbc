"""Products with J, the derivatives of overlapping patches by each grain's motion: J x, Jᵀ y, and blocks of JᵀJ.

Patches are those of `kernels.layout`, ``derivatives (6, pixels)`` lie in them.

Products of single numbers are exact in double precision, and are added up in it: JᵀJ then has no eigenvalue below
zero by more than some 1e-15 of the largest, whatever the processor and its order of sums.
"""

from __future__ import annotations

import numba as nb
import numpy as np

from grainmotion.kernels.compilation import CACHE


@nb.njit(parallel=True, cache=CACHE, fastmath=True, error_model="numpy")
def vjp(derivatives, boxes, offsets, stacks, out):
    """Jᵀ y: dot products ``out (k, patches, 6)`` of each patch's derivatives with ``stacks (k, views, rows, columns)``.

    Sums do not depend on the number of stacks.
    """
    for p in nb.prange(len(boxes)):
        i, r0, r1, c0, c1 = boxes[p, 1], boxes[p, 2], boxes[p, 3], boxes[p, 4], boxes[p, 5]
        width = c1 - c0
        for q in range(len(stacks)):
            t0, t1, t2, t3, t4, t5 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
            for r in range(r0, r1):
                at, image = offsets[p] + (r - r0) * width, stacks[q, i, r, c0:c1]
                d0, d1 = derivatives[0, at : at + width], derivatives[1, at : at + width]
                d2, d3 = derivatives[2, at : at + width], derivatives[3, at : at + width]
                d4, d5 = derivatives[4, at : at + width], derivatives[5, at : at + width]
                for c in range(width):
                    value = np.float64(image[c])
                    t0 += np.float64(d0[c]) * value
                    t1 += np.float64(d1[c]) * value
                    t2 += np.float64(d2[c]) * value
                    t3 += np.float64(d3[c]) * value
                    t4 += np.float64(d4[c]) * value
                    t5 += np.float64(d5[c]) * value
            out[q, p, 0], out[q, p, 1], out[q, p, 2] = t0, t1, t2
            out[q, p, 3], out[q, p, 4], out[q, p, 5] = t3, t4, t5


@nb.njit(parallel=True, cache=CACHE, fastmath=True, error_model="numpy")
def dots(left, right, offsets, out):
    """Sums ``out (groups, k, m)`` over the pixels of each group of ``left (k, pixels)`` times ``right (m, pixels)``.

    Group g is from ``offsets[g]`` to ``offsets[g + 1]``.
    """
    for g in nb.prange(len(offsets) - 1):
        start, end = offsets[g], offsets[g + 1]
        for k in range(len(left)):
            for m in range(len(right)):
                a, b = left[k, start:end], right[m, start:end]
                total = 0.0
                for c in range(len(a)):
                    total += np.float64(a[c]) * np.float64(b[c])
                out[g, k, m] = total


ROWS_OF_A_THREAD = 32  # of an image that J x fills


@nb.njit(parallel=True, cache=CACHE, fastmath=True, error_model="numpy")
def jvp(derivatives, boxes, offsets, order, first, increments, stacks):
    """J x: fill ``stacks (k, views, rows, columns)`` with what ``increments (k, n, 6)`` of the grains change.

    ``order[first[i]:first[i + 1]]`` are the patches of view i.  Each patch is worked out in the derivatives' precision;
    images in double precision add single numbers up exactly, so that no order of sums shows.
    """
    _, views, rows, columns = stacks.shape
    bands = (rows + ROWS_OF_A_THREAD - 1) // ROWS_OF_A_THREAD
    for job in nb.prange(views * bands):
        i, low = job // bands, job % bands * ROWS_OF_A_THREAD
        high = min(low + ROWS_OF_A_THREAD, rows)
        stacks[:, i, low:high] = 0
        work = np.empty(ROWS_OF_A_THREAD * columns, derivatives.dtype)
        for e in range(first[i], first[i + 1]):
            p = order[e]
            g, c0, c1 = boxes[p, 0], boxes[p, 4], boxes[p, 5]
            r0, r1, width = max(boxes[p, 2], low), min(boxes[p, 3], high), c1 - c0
            if r0 >= r1:
                continue
            at = offsets[p] + (r0 - boxes[p, 2]) * width
            end = at + (r1 - r0) * width
            d0, d1, d2 = derivatives[0, at:end], derivatives[1, at:end], derivatives[2, at:end]
            d3, d4, d5 = derivatives[3, at:end], derivatives[4, at:end], derivatives[5, at:end]
            pixels = work[: end - at]
            f = derivatives.dtype.type
            for q in range(len(stacks)):
                x = increments[q, g]
                v0, v1, v2, v3, v4, v5 = f(x[0]), f(x[1]), f(x[2]), f(x[3]), f(x[4]), f(x[5])
                for c in range(len(pixels)):
                    pixels[c] = v0 * d0[c] + v1 * d1[c] + v2 * d2[c] + v3 * d3[c] + v4 * d4[c] + v5 * d5[c]
                for r in range(r0, r1):
                    line, image = pixels[(r - r0) * width : (r - r0 + 1) * width], stacks[q, i, r, c0:c1]
                    for c in range(width):
                        image[c] += line[c]


@nb.njit(parallel=True, cache=CACHE, fastmath=True, error_model="numpy")
def gram_blocks(derivatives, boxes, offsets, pairs, first, out):
    """6×6 blocks ``out (blocks, 6, 6)`` of JᵀJ: block q sums over patch pairs ``pairs[first[q]:first[q + 1]]``."""
    for q in nb.prange(len(first) - 1):
        for k in range(6):
            for m in range(6):
                out[q, k, m] = 0.0
        for e in range(first[q], first[q + 1]):
            p, t = pairs[e, 0], pairs[e, 1]
            r0, r1 = max(boxes[p, 2], boxes[t, 2]), min(boxes[p, 3], boxes[t, 3])
            c0, c1 = max(boxes[p, 4], boxes[t, 4]), min(boxes[p, 5], boxes[t, 5])
            width = c1 - c0
            wp, wt = boxes[p, 5] - boxes[p, 4], boxes[t, 5] - boxes[t, 4]
            for r in range(r0, r1):
                ap = offsets[p] + (r - boxes[p, 2]) * wp + c0 - boxes[p, 4]
                at = offsets[t] + (r - boxes[t, 2]) * wt + c0 - boxes[t, 4]
                for k in range(6):
                    left = derivatives[k, ap : ap + width]
                    for m in range(k if p == t else 0, 6):
                        right = derivatives[m, at : at + width]
                        part = 0.0
                        for c in range(width):
                            part += np.float64(left[c]) * np.float64(right[c])
                        out[q, k, m] += part
            if p == t:
                for k in range(6):
                    for m in range(k):
                        out[q, k, m] = out[q, m, k]
