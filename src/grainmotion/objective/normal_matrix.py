"""The normal matrix of grains whose shadows overlap: in blocks, or for many grains as a product only.

In a packing every grain shares pixels with a large part of the others (with a third of 1,000 in four views), so
blocks cost far more than the patches that they are made of, and a factor of them fills up.  The product is two passes
over the patches: the images that increments make, and what these give to each grain.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from grainmotion._typing import Float, Image
from grainmotion.backends import patchwork
from grainmotion.backends.device import place
from grainmotion.projection.grains import Patches
from grainmotion.solvers.block_cg import MAX_DENSE_UNKNOWNS


@dataclass(frozen=True, eq=False)
class PatchNormalMatrix:
    """JᵀJ of filtered patches as a `block_cg.NormalMatrix`.

    ``derivatives (6, pixels)`` lie in ``patches`` of ``grains`` grains, ``panels`` is (views, rows, columns), and
    ``raised (n, 6, 6)`` is what a prior adds to the blocks on the diagonal.
    """

    derivatives: Any
    patches: Patches
    grains: int
    panels: tuple[int, int, int]
    raised: Float | None = None

    @property
    def shape(self) -> tuple[int, int]:
        """Unknowns, twice."""
        return 6 * self.grains, 6 * self.grains

    def blocks(self) -> Float:
        """The blocks on the diagonal ``(n, 6, 6)``."""
        return self._own if self.raised is None else self._own + self.raised

    def diagonal(self) -> Float:
        """The diagonal ``(6n,)``."""
        return np.diagonal(self.blocks(), axis1=1, axis2=2).ravel()

    def __matmul__(self, x: Float) -> Float:
        """JᵀJ x of ``(6n,)`` or of columns ``(6n, k)``."""
        boxes, offsets, order, first = self._tables
        each = x.reshape(self.grains, 6, -1).transpose(2, 0, 1)
        stacks = patchwork.spread(self.derivatives, boxes, offsets, order, first, each, self.panels)
        parts = patchwork.gradients(self.derivatives, boxes, offsets, stacks)
        out = np.stack([_by_grain(part, self.patches, self.grains) for part in parts])
        if self.raised is not None:
            out += np.einsum("nij,knj->kni", self.raised, each)
        return out.transpose(1, 2, 0).reshape(x.shape)

    def lifted(self, blocks: Float) -> PatchNormalMatrix:
        """The same with 6×6 blocks ``(n, 6, 6)`` added on the diagonal."""
        return replace(self, raised=blocks if self.raised is None else self.raised + blocks)

    @cached_property
    def _tables(self) -> list[Any]:
        """What the product asks of the patches, where the derivatives lie."""
        device = place(self.derivatives)
        return [device.hold(a) for a in (self.patches.boxes, self.patches.offsets, *self.patches.by_view)]

    @cached_property
    def _own(self) -> Float:
        boxes = self.patches.boxes
        pairs = np.repeat(np.arange(len(boxes)), 2).reshape(-1, 2)  # patches follow their grains
        first = np.searchsorted(boxes[:, 0], np.arange(self.grains + 1))
        out = np.zeros((self.grains, 6, 6))
        patchwork.blocks(self.derivatives, boxes, self.patches.offsets, pairs, first, out)
        return out


def normal_of(
    derivatives: Any, patches: Patches, n: int, panels: tuple[int, int, int]
) -> sparse.bsr_array | PatchNormalMatrix:
    """JᵀJ of filtered patches, as the solver wants it: in blocks while a dense factor is taken, else a product."""
    if 6 * n <= MAX_DENSE_UNKNOWNS:
        return normal_matrix(derivatives, patches, n)
    return PatchNormalMatrix(derivatives, patches, n, panels)


def spread(derivatives: Any, patches: Patches, increments: Float, panels: tuple[int, int, int]) -> list[Image]:
    """J x: the k stacks of images that increments ``(k, n, 6)`` make."""
    stacks = patchwork.spread(derivatives, patches.boxes, patches.offsets, *patches.by_view, increments, panels)
    return [np.asarray(images) for images in stacks]


def gathered(derivatives: Any, patches: Patches, n: int, images: Image) -> Float:
    """Jᵀ y of images, ``(n, 6)``."""
    (parts,) = patchwork.gradients(derivatives, patches.boxes, patches.offsets, [images])
    return _by_grain(parts, patches, n)


def _by_grain(parts: Float, patches: Patches, n: int) -> Float:
    """Sums ``(n, 6)`` over each grain's patches."""
    out = np.zeros((n, 6))
    np.add.at(out, patches.boxes[:, 0], parts)
    return out


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
    patchwork.blocks(derivatives, boxes, patches.offsets, np.ascontiguousarray(pairs[order]), bounds, out)
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
