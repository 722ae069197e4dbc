"""A small table of patches that overlap, with random derivatives, and the Jacobian as a dense matrix."""

import numpy as np

from grainmotion.kernels.layout import patch_table

SHAPE = (2, 40, 9)  # views, rows, columns: more rows than a thread of J x takes at once
GRAINS = 3
BOXES = np.array(
    [  # grain, view, first row, end row, first column, end column
        [0, 0, 0, 5, 0, 4],
        [0, 1, 28, 36, 3, 9],
        [1, 0, 2, 7, 1, 8],
        [1, 1, 30, 40, 0, 5],
        [2, 1, 33, 34, 4, 6],
    ]
)
TABLE = patch_table(BOXES, np.zeros((0, 4), np.int64), SHAPE[0])
DERIVATIVES = np.random.default_rng(0).normal(size=(6, TABLE.offsets[-1]))


def dense_jacobian():
    """J as a matrix ``(pixels of all views, 6 n)``."""
    columns = np.zeros((*SHAPE, GRAINS, 6))
    for (grain, view, r0, r1, c0, c1), start, end in zip(BOXES, TABLE.offsets[:-1], TABLE.offsets[1:], strict=True):
        patch = DERIVATIVES[:, start:end].T.reshape(r1 - r0, c1 - c0, 6)
        columns[view, r0:r1, c0:c1, grain] += patch
    return columns.reshape(-1, 6 * GRAINS)


def pairs_of(one, other):
    """Pairs of patches of two grains in the same view, as `gram_blocks` takes them for one block."""
    pairs = [(p, q) for p, a in enumerate(BOXES) for q, b in enumerate(BOXES) if (a[0], b[0]) == (one, other)]
    return np.array([(p, q) for p, q in pairs if BOXES[p, 1] == BOXES[q, 1]])
