"""Footprints of moving grains on the detector.

The outline of a footprint is convex.  It is bounded by the extents of the projected hull along `OUTLINE_DIRECTIONS`
(row, column) of the detector: it lies between two lines across each of them.
"""

from __future__ import annotations

import numba as nb
import numpy as np

from grainmotion.kernels.compilation import CACHE

_ANGLES = np.arange(8) * np.pi / 8
OUTLINE_DIRECTIONS = np.stack([np.cos(_ANGLES), np.sin(_ANGLES)], axis=1)
"""Unit vectors (row, column), the first along rows, the fifth along columns."""

BEHIND = 1e-12
"""Depth over the source's distance below which a point is not in front of the source."""


@nb.njit(parallel=True, cache=CACHE, error_model="numpy")
def extents(hulls, positions, matrices, inverses, origins, cone, panel, directions, out):
    """Least and largest a·row + b·column of each grain's hull, ``out (n, views, directions, 2)``.

    ``inverses (views, 3, 3)`` and ``origins (views, 3)`` carry a point x to q = M (x − o), with (column, row) from
    the panel's centre q₀/q₂, q₁/q₂ in a cone and q₀, q₁ in a parallel beam.  A hull that is not all in front of the
    source has extents of NaN.
    """
    for g in nb.prange(len(hulls)):
        m, x = matrices[g], positions[g]
        for i in range(len(inverses)):
            a, o = inverses[i], origins[i]
            for d in range(len(directions)):
                out[g, i, d, 0], out[g, i, d, 1] = np.inf, -np.inf
            for k in range(hulls.shape[1]):
                h = hulls[g, k]
                y0 = m[0, 0] * h[0] + m[0, 1] * h[1] + m[0, 2] * h[2] + x[0] - o[0]
                y1 = m[1, 0] * h[0] + m[1, 1] * h[1] + m[1, 2] * h[2] + x[1] - o[1]
                y2 = m[2, 0] * h[0] + m[2, 1] * h[1] + m[2, 2] * h[2] + x[2] - o[2]
                column = a[0, 0] * y0 + a[0, 1] * y1 + a[0, 2] * y2
                row = a[1, 0] * y0 + a[1, 1] * y1 + a[1, 2] * y2
                if cone:
                    depth = a[2, 0] * y0 + a[2, 1] * y1 + a[2, 2] * y2
                    if depth < BEHIND:
                        for d in range(len(directions)):
                            out[g, i, d, 0] = out[g, i, d, 1] = np.nan
                        break
                    row, column = row / depth, column / depth
                row, column = row + (panel[0] - 1) / 2, column + (panel[1] - 1) / 2
                for d in range(len(directions)):
                    along = directions[d, 0] * row + directions[d, 1] * column
                    out[g, i, d, 0] = min(out[g, i, d, 0], along)
                    out[g, i, d, 1] = max(out[g, i, d, 1], along)


@nb.njit(cache=CACHE, error_model="numpy")
def lines(outline, boxes, directions, slack, out):
    """Pixels in the footprint, of each patch's rows, as jobs (patch, row, first column, end column); returns how many.

    ``outline (patches, directions, 2)`` are the extents, to be widened by ``slack (patches,)``, ``boxes`` the patches'
    own pixels (first row, end row, first column, end column); rows without a pixel are left out.
    """
    count = 0
    for p in range(len(boxes)):
        for r in range(boxes[p, 0], boxes[p, 1]):
            low, high = -np.inf, np.inf
            for d in range(1, len(directions)):
                down, right = directions[d, 0] * r, directions[d, 1]
                low = max(low, (outline[p, d, 0] - slack[p] - down) / right)
                high = min(high, (outline[p, d, 1] + slack[p] - down) / right)
            first, end = max(boxes[p, 2], int(np.ceil(low))), min(boxes[p, 3], int(np.floor(high)) + 1)
            if first < end:
                out[count, 0], out[count, 1], out[count, 2], out[count, 3] = p, r, first, end
                count += 1
    return count
