"""Connected components of the voxels of a volume, which need little memory beside it (`kernels.connected_runs`)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from grainmotion.kernels import connected_runs as kernels
from grainmotion.model.progress import counted
from grainmotion.segmentation.blocks import Work, slabs_of


@dataclass(frozen=True, eq=False)
class Components:
    """Components 0 … n - 1, in the order of their first voxels; voxels are neighbours if they share a face.

    Attributes
    ----------
    shape : tuple of int
        Of the volume.
    runs : (offsets, starts, stops) of int arrays
        Runs of each row, and where they start and stop.
    number : (runs,) int32 array
        Component of each run.
    sizes : (n,) int array
        Voxels.
    at_border : (n,) bool array
        Whether it reaches a face of the volume.
    codes : (n,) array
        The code of its voxels.
    """

    shape: tuple[int, int, int]
    runs: tuple[NDArray[np.int64], NDArray[np.int32], NDArray[np.int32]]
    number: NDArray[np.int32]
    sizes: NDArray[np.int64]
    at_border: NDArray[np.bool_]
    codes: NDArray[np.uint8]

    @classmethod
    def of(cls, codes: NDArray, work: Work, empty: bool = False) -> Components:
        """Components of equal codes other than 0, or of the empty voxels of a mask."""
        codes, flip = codes.view(np.uint8), int(empty)
        nz, ny, _ = shape = (codes.shape[0], codes.shape[1], codes.shape[2])
        counts, slabs = np.zeros(nz * ny, np.int64), slabs_of(shape)
        work.each(slabs, lambda slab: kernels.count_runs(codes, flip, *slab, counts))
        offsets = np.concatenate([[0], np.cumsum(counts)])
        starts, stops, number = (np.empty(int(offsets[-1]), np.int32) for _ in range(3))
        runs = offsets, starts, stops
        work.each(slabs, lambda slab: kernels.write_runs(codes, flip, *slab, *runs, number))
        for first, _ in counted(slabs[1:]):
            kernels.join_planes(codes, flip, first, *runs, number)
        n = kernels.number_components(number)
        sizes, at_border, places = np.zeros(n, np.int64), np.zeros(n, bool), np.zeros(n, np.int64)
        kernels.measure_components(shape, *runs, number, sizes, at_border, places)
        return cls(shape, runs, number, sizes, at_border, codes.reshape(-1)[places])

    def holding(self, mask: NDArray) -> NDArray[np.bool_]:
        """Which components ``(n,)`` have a voxel in a mask."""
        marked = np.zeros(len(self.sizes), bool)
        kernels.mark_components(mask.view(np.uint8), *self.runs, self.number, marked)
        return marked

    def paint(self, out: NDArray, values: NDArray, work: Work) -> None:
        """Write the values ``(n,)`` of components into their voxels, but where they are 0."""
        work.each(
            slabs_of(self.shape), lambda slab: kernels.paint_components(out, *slab, *self.runs, self.number, values)
        )


def fill_holes(mask: NDArray[np.bool_], work: Work) -> None:
    """Fill, in place, what is connected with no face of the volume by voxels out of the mask."""
    outside = Components.of(mask, work, empty=True)
    outside.paint(mask.view(np.uint8), (~outside.at_border).astype(np.uint8), work)
