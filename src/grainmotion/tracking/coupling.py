"""The block-sparse normal matrix of grains whose shadows overlap."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from grainmotion.kernels import normal
from grainmotion.packed import Image
from grainmotion.project import Patches

Float = NDArray[np.float64]


def normal_matrix(derivatives: Image, patches: Patches, n: int) -> sparse.bsr_array:
    """JᵀJ ``(6n, 6n)`` of filtered patches: grains couple where their patches overlap in a view."""
    return block_matrix(*coupling_blocks(derivatives, patches.boxes, patches.offsets), n)


def coupling_blocks(
    derivatives: Image,
    boxes: NDArray[np.int64],
    offsets: NDArray[np.int64],
    own: NDArray[np.bool_] | None = None,
) -> tuple[NDArray[np.int64], Float]:
    """Pairs of grains ``(k, 2)``, first <= second, and their 6×6 blocks of JᵀJ ``(k, 6, 6)``.

    ``own (patches,)`` leaves out the pairs of which neither patch is so marked.
    """
    pairs = _overlaps(boxes)
    if own is not None:
        pairs = pairs[own[pairs].any(axis=1)]
    grains = np.sort(boxes[pairs, 0], axis=1)
    swap = boxes[pairs[:, 0], 0] > boxes[pairs[:, 1], 0]
    pairs[swap] = pairs[swap][:, ::-1]
    n = int(boxes[:, 0].max(initial=0)) + 1
    key = grains[:, 0] * n + grains[:, 1]
    order = np.argsort(key, kind="stable")  # views stay in their order
    unique, first = np.unique(key[order], return_index=True)
    out = np.zeros((len(unique), 6, 6))
    bounds = np.append(first, len(order)).astype(np.int64)
    normal.blocks(derivatives, boxes, offsets, np.ascontiguousarray(pairs[order]), bounds, out)
    return np.stack([unique // n, unique % n], axis=1), out


def block_matrix(pairs: NDArray[np.int64], blocks: Float, n: int) -> sparse.bsr_array:
    """The symmetric matrix ``(6n, 6n)`` of 6×6 blocks at ``pairs (k, 2)``, first <= second."""
    i, j = pairs[:, 0], pairs[:, 1]
    off = i != j
    rows, columns = np.concatenate([i, j[off]]), np.concatenate([j, i[off]])
    data = np.concatenate([blocks, np.swapaxes(blocks[off], 1, 2)])
    order = np.lexsort((columns, rows))
    indptr = np.concatenate([[0], np.cumsum(np.bincount(rows, minlength=n))])
    return sparse.bsr_array((data[order], columns[order], indptr), shape=(6 * n, 6 * n))


def _overlaps(boxes: NDArray[np.int64]) -> NDArray[np.int64]:
    """Pairs (p, q), p <= q, of patches of one view that share pixels, each patch with itself included."""
    found = []
    for view in np.unique(boxes[:, 1]):
        index = np.nonzero(boxes[:, 1] == view)[0]
        index = index[np.argsort(boxes[index, 2], kind="stable")]
        b = boxes[index]
        ends = np.searchsorted(b[:, 2], b[:, 3], side="left")
        for k, end in enumerate(ends):
            other = np.arange(k, end)
            meets = (b[other, 4] < b[k, 5]) & (b[other, 5] > b[k, 4])
            meets[0] = True
            found.append(np.column_stack([np.full(meets.sum(), index[k]), index[other[meets]]]))
    return np.concatenate(found).astype(np.int64) if found else np.zeros((0, 2), np.int64)
