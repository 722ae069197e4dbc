"""The block-sparse normal matrix of grains whose shadows overlap."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from grainmotion.patchwork import blocks
from grainmotion.project import Patches


def normal_matrix(derivatives: Any, patches: Patches, n: int) -> sparse.bsr_array:
    """JᵀJ ``(6n, 6n)`` of filtered patches: grains couple where their patches overlap in a view."""
    boxes = patches.boxes
    pairs = _overlaps(boxes)
    grains = np.sort(boxes[pairs, 0], axis=1)
    swap = boxes[pairs[:, 0], 0] > boxes[pairs[:, 1], 0]
    pairs[swap] = pairs[swap][:, ::-1]
    key = grains[:, 0] * n + grains[:, 1]
    order = np.argsort(key, kind="stable")
    unique, first = np.unique(key[order], return_index=True)
    out = np.zeros((len(unique), 6, 6))
    bounds = np.append(first, len(order)).astype(np.int64)
    blocks(derivatives, boxes, patches.offsets, np.ascontiguousarray(pairs[order]), bounds, out)
    i, j = unique // n, unique % n
    off = i != j
    rows, columns = np.concatenate([i, j[off]]), np.concatenate([j, i[off]])
    data = np.concatenate([out, np.swapaxes(out[off], 1, 2)])
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
