"""Gaussian filters of radiographs and of patches (`kernels.layout`).

Beyond the panel everything counts as zero, in residuals and derivatives alike, so that filtering stays linear and the
two stay consistent.
"""

from __future__ import annotations

import numba as nb
import numpy as np

from grainmotion.kernels.compilation import CACHE


@nb.njit(cache=CACHE, fastmath=True, error_model="numpy")
def _add_scaled(target, source, weight):
    for c in range(len(target)):
        target[c] += weight * source[c]


@nb.njit(cache=CACHE, error_model="numpy")
def _smooth(image, work, weights):
    """Convolve ``image (rows, columns)`` in place, along rows then columns, with the symmetric half-kernel.

    Empty rows (the margins of a patch) are passed over.
    """
    rows, columns = image.shape
    reach = len(weights) - 1
    work[:] = 0
    first, last = rows, -1
    for r in range(rows):
        if not image[r].any():
            continue
        first, last = min(first, r), r
        _add_scaled(work[r], image[r], weights[0])
        for k in range(1, min(reach, columns - 1) + 1):
            _add_scaled(work[r, : columns - k], image[r, k:], weights[k])
            _add_scaled(work[r, k:], image[r, : columns - k], weights[k])
    image[:] = 0
    for r in range(rows):
        for source in range(max(first, r - reach), min(last, r + reach) + 1):
            _add_scaled(image[r], work[source], weights[abs(source - r)])


@nb.njit(parallel=True, cache=CACHE, error_model="numpy")
def filter_images(images, weights):
    """Filter ``images (n, rows, columns)`` in place."""
    n, rows, columns = images.shape
    for i in nb.prange(n):
        _smooth(images[i], np.empty((rows, columns), images.dtype), weights)


@nb.njit(cache=CACHE, fastmath=True, error_model="numpy")
def _smooth_laid_out(source, target, weights, stride):
    """Convolve pixels that lie one after the other with the symmetric half-kernel, neighbours ``stride`` apart.

    What lies before and after is zero.  One loop over all pixels a weight: loops over short rows are slow.
    """
    n = len(source)
    for c in range(n):
        target[c] = weights[0] * source[c]
    for k in range(1, len(weights)):
        step, weight = k * stride, weights[k]
        if step < n:
            ahead, behind, near, far = source[step:], source[: n - step], target[: n - step], target[step:]
            for c in range(n - step):
                near[c] += weight * ahead[c]
            for c in range(n - step):
                far[c] += weight * behind[c]


@nb.njit(parallel=True, cache=CACHE, error_model="numpy")
def filter_patches(derivatives, boxes, offsets, valid, weights):
    """Mask, then filter each patch of ``derivatives (k, pixels)`` in place; ``valid`` is (views, rows, columns)."""
    each, reach = len(derivatives), len(weights) - 1
    for p in nb.prange(len(boxes)):
        i, r0, r1, c0, c1 = boxes[p, 1], boxes[p, 2], boxes[p, 3], boxes[p, 4], boxes[p, 5]
        rows, columns = r1 - r0, c1 - c0
        wide = columns + reach  # zeros keep the rows apart
        source = np.zeros(rows * wide, derivatives.dtype)
        work = np.empty(rows * wide, derivatives.dtype)
        for k in range(each):
            patch = derivatives[k, offsets[p] : offsets[p + 1]]
            for r in range(rows):
                line, factor = patch[r * columns : (r + 1) * columns], valid[i, r0 + r, c0:c1]
                masked = source[r * wide : r * wide + columns]
                for c in range(columns):
                    masked[c] = line[c] * factor[c]
            if reach > 0:
                _smooth_laid_out(source, work, weights, 1)
                _smooth_laid_out(work, source, weights, wide)
            for r in range(rows):
                line, done = patch[r * columns : (r + 1) * columns], source[r * wide : r * wide + wide]
                for c in range(columns):
                    line[c] = done[c]
                done[columns:] = 0
