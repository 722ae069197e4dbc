"""The normal matrix JᵀJ of grains whose footprints overlap: in blocks, or for many grains as a product only.

In a packing every grain shares pixels with a large part of the others (with a third of 1,000 in four views), so
blocks cost far more than the patches that they are made of, and a factor of them fills up.  The product is two passes
over the patches: J x as radiographs, and Jᵀ of these.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from grainmotion._typing import Float
from grainmotion.model.progress import reached
from grainmotion.projection.jacobian import PatchJacobian
from grainmotion.solvers.block_cg import MAX_DENSE_UNKNOWNS

USUAL_PRODUCTS = 20
"""Products of a solve, about: after as many progress has come half of its way."""


@dataclass(frozen=True, eq=False)
class PatchNormalMatrix:
    """JᵀJ of a filtered Jacobian as a `block_cg.NormalMatrix`; ``added (n, 6, 6)`` are blocks added on its diagonal."""

    jacobian: PatchJacobian
    added: Float | None = None
    _numbers: Iterator[int] = field(default_factory=lambda: itertools.count(1), init=False)

    @property
    def shape(self) -> tuple[int, int]:
        """Unknowns, twice."""
        return 6 * len(self.jacobian), 6 * len(self.jacobian)

    def blocks(self) -> Float:
        """The blocks on the diagonal ``(n, 6, 6)``."""
        return self._own_blocks if self.added is None else self._own_blocks + self.added

    def diagonal(self) -> Float:
        """The diagonal ``(6n,)``."""
        return np.diagonal(self.blocks(), axis1=1, axis2=2).ravel()

    def __matmul__(self, x: Float) -> Float:
        """JᵀJ x of ``(6n,)`` or of columns ``(6n, k)``."""
        number = next(self._numbers)
        reached(number / (number + USUAL_PRODUCTS))
        each = x.reshape(len(self.jacobian), 6, -1).transpose(2, 0, 1)
        parts = self.jacobian.vjp(self.jacobian.jvp(each))
        out = np.stack([self.jacobian.by_grain(part) for part in parts])
        if self.added is not None:
            out += np.einsum("nij,knj->kni", self.added, each)
        return out.transpose(1, 2, 0).reshape(x.shape)

    def lifted(self, blocks: Float) -> PatchNormalMatrix:
        """The same with 6×6 blocks ``(n, 6, 6)`` added on the diagonal."""
        return replace(self, added=blocks if self.added is None else self.added + blocks)

    @cached_property
    def _own_blocks(self) -> Float:
        boxes = self.jacobian.patches.boxes
        pairs = np.repeat(np.arange(len(boxes)), 2).reshape(-1, 2)  # patches follow their grains
        first = np.searchsorted(boxes[:, 0], np.arange(len(self.jacobian) + 1))
        return self.jacobian.gram_blocks(pairs, first)


def normal_of(jacobian: PatchJacobian) -> sparse.bsr_array | PatchNormalMatrix:
    """JᵀJ of a filtered Jacobian as the solver wants it: in blocks while a dense factor is taken, else a product."""
    if 6 * len(jacobian) <= MAX_DENSE_UNKNOWNS:
        return normal_matrix(jacobian)
    return PatchNormalMatrix(jacobian)


def normal_matrix(jacobian: PatchJacobian) -> sparse.bsr_array:
    """JᵀJ ``(6n, 6n)`` in blocks: grains couple where their patches overlap in a view."""
    boxes, n = jacobian.patches.boxes, len(jacobian)
    pairs = _overlaps(boxes)
    grains = np.sort(boxes[pairs, 0], axis=1)
    swap = boxes[pairs[:, 0], 0] > boxes[pairs[:, 1], 0]
    pairs[swap] = pairs[swap][:, ::-1]
    key = grains[:, 0] * n + grains[:, 1]
    order = np.argsort(key, kind="stable")
    unique, first = np.unique(key[order], return_index=True)
    bounds = np.append(first, len(order)).astype(np.int64)
    blocks = jacobian.gram_blocks(np.ascontiguousarray(pairs[order]), bounds)
    i, j = unique // n, unique % n
    off = i != j
    rows, columns = np.concatenate([i, j[off]]), np.concatenate([j, i[off]])
    data = np.concatenate([blocks, np.swapaxes(blocks[off], 1, 2)])
    order = np.lexsort((columns, rows))
    indptr = np.concatenate([[0], np.cumsum(np.bincount(rows, minlength=n))])
    return sparse.bsr_array((data[order], columns[order], indptr), shape=(6 * n, 6 * n))


def _overlaps(boxes: NDArray[np.int64]) -> NDArray[np.int64]:
    """Pairs (p, q), p <= q, of patches of one view that share pixels, each patch with itself included."""
    pairs = []
    for view in np.unique(boxes[:, 1]):
        index = np.nonzero(boxes[:, 1] == view)[0]
        index = index[np.argsort(boxes[index, 2], kind="stable")]
        b = boxes[index]
        ends = np.searchsorted(b[:, 2], b[:, 3], side="left")
        for k, end in enumerate(ends):
            other = np.arange(k, end)
            meets = (b[other, 4] < b[k, 5]) & (b[other, 5] > b[k, 4])
            meets[0] = True
            pairs.append(np.column_stack([np.full(meets.sum(), index[k]), index[other[meets]]]))
    return np.concatenate(pairs).astype(np.int64) if pairs else np.zeros((0, 2), np.int64)
