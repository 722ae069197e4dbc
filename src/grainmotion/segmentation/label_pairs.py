"""Pairs of labels that touch: numbers of faces of voxels between them, and the values along these."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from grainmotion.kernels.label_faces import add_faces, add_marks, empty_table, gather_pairs
from grainmotion.segmentation.blocks import Block, Work, blocks_of

Ints = NDArray[np.int32]
Marks = Callable[[Block], NDArray[np.int32]]

_PLACES = 1 << 10
_NO_MARKS = np.zeros((0, 0, 0), np.int32)


@dataclass(frozen=True, eq=False)
class LabelPairs:
    """Pairs of labels, each once, in rising order.

    Attributes
    ----------
    pairs : (k, 2) int array
        The lower label first.
    faces : (k, 3) int array
        Faces across z, y and x.
    marks : (k,) int array
        Sum of both voxels' marks over all faces.
    tops : (k, 4) float32 array
        The highest of the values of faces, falling; a face has the lower value of its two voxels.
    beside : (k,) float32 array
        The higher value at the first of these faces.
    surface : (n + 1,) int array
        Faces of each label with any other number, 0 as well.
    label_marks : (n + 1,) int array
        Sum of the marks of each label's voxels.
    """

    pairs: NDArray[np.int64]
    faces: NDArray[np.int64]
    marks: NDArray[np.int64]
    tops: NDArray[np.float32]
    beside: NDArray[np.float32]
    surface: NDArray[np.int64]
    label_marks: NDArray[np.int64]

    @classmethod
    def of(
        cls, labels: NDArray[np.integer], values: NDArray, count: int, work: Work, marks: Marks | None = None
    ) -> LabelPairs:
        """Pairs of touching labels.

        Parameters
        ----------
        labels : (nz, ny, nx) int32 array
            1 … ``count``; others are none.
        values : (nz, ny, nx) array
            One a voxel.
        count : int
            The highest label.
        work : Work
            Threads.
        marks : callable, optional
            Whole numbers, up to 2**30, of the voxels of a block and of one voxel more on each side.

        Returns
        -------
        LabelPairs
            The same whatever the blocks.
        """

        def start() -> tuple:
            return empty_table(_PLACES), np.zeros(count + 1, np.int64), np.zeros(count + 1, np.int64)

        def add(block: Block, found: tuple) -> tuple:
            table, surface, sums = found
            if not labels[block.grown(1, labels.shape).box].any():
                return found
            numbers = _NO_MARKS if marks is None else marks(block)
            origin = tuple(a - 1 for a in block.start)
            limits = tuple(block.limits.tolist())
            if marks is not None:
                add_marks(labels[block.box], numbers, sums)
            return add_faces(table, labels, values, numbers, limits, origin, count + 1, surface), surface, sums

        parts = work.gathered(blocks_of(labels.shape), start, add)
        used = [np.flatnonzero(table[0]) for table, _, _ in parts]
        keys, sums, tops = (
            np.concatenate([table[k][rows] for (table, _, _), rows in zip(parts, used, strict=True)]) for k in range(3)
        )
        of_labels = tuple(np.asarray(sum(part[k] for part in parts)) for k in (1, 2))
        pairs = np.column_stack([keys // (count + 1), keys % (count + 1)])
        return cls._gathered(pairs, sums, tops, of_labels)

    def renumbered(self, new: NDArray[np.integer]) -> LabelPairs:
        """Pairs of the labels under new numbers ``(n + 1,)``, of which 0 is none."""
        count, pairs = int(new.max(initial=0)), new[self.pairs].astype(np.int64)
        faces = self.faces.sum(axis=1)
        surface = np.bincount(new, self.surface, minlength=count + 1).astype(np.int64)
        inside = pairs[:, 0] == pairs[:, 1]
        surface -= 2 * np.bincount(pairs[inside, 0], faces[inside], minlength=count + 1).astype(np.int64)
        surface[0] = 0
        kept = ~inside & (pairs > 0).all(axis=1)
        sums, tops = np.column_stack([self.faces, self.marks])[kept], np.column_stack([self.tops, self.beside])[kept]
        marks = np.bincount(new, self.label_marks, minlength=count + 1).astype(np.int64)
        return self._gathered(np.sort(pairs[kept], axis=1), sums, tops, (surface, marks))

    @classmethod
    def _gathered(cls, pairs: NDArray, sums: NDArray, tops: NDArray, of_labels: tuple) -> LabelPairs:
        """Each pair once."""
        order = np.lexsort((pairs[:, 1], pairs[:, 0]))
        pairs = pairs[order]
        start = np.flatnonzero(np.concatenate([[True], (np.diff(pairs, axis=0) != 0).any(axis=1)])[: len(pairs)])
        sums, tops = gather_pairs(pairs[:, 0].copy(), sums[order], tops[order], start)
        return cls(pairs[start], sums[:, :3], sums[:, 3], tops[:, :4], tops[:, 4], *of_labels)
