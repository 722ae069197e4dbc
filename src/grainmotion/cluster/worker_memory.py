"""How much memory a worker of a run needs, from the sizes of scan and volume."""

from __future__ import annotations

import math
from dataclasses import dataclass

from grainmotion.cluster.dask_backend import worth_sharing
from grainmotion.reconstruction.slabs import slab_bounds

BYTES_OF_WORKER = 0.48e9
"""Python, Dask, the libraries and the compiled kernels."""
COPIES_OF_SLAB, BYTES_OF_NUMBER = 5, 4
"""Of a slab in progress: image and the one before, the copies that an update makes of both, and the corrections."""
SHARE_OF_ROWS = 1.15
"""Rows of pixels that all slabs need, over those of the panel: those of a cone overlap."""
BYTES_PER_VOXEL_OF_FEW, BYTES_OF_MANY, BYTES_PER_VOXEL_OF_MANY = 50, 0.45e9, 14.5
"""Of a voxel of the volume: all grains' own voxels, and their patches; where grains are many their finer voxels are
kept compactly, and those of a batch of grains are made at a time."""


@dataclass(frozen=True)
class ScanSize:
    """Voxels of a volume along z, y, x, and views, rows and columns of its scan; no views where it is given."""

    volume: tuple[int, int, int]
    views: int
    rows: int
    columns: int


def memory_of_worker(size: ScanSize, workers: int) -> float:
    """Estimate of what each worker holds at the peak of a run, bytes: of its slabs, or of all grains."""
    return BYTES_OF_WORKER + max(_of_slabs(size, workers), _of_grains(size, workers))


def _of_slabs(size: ScanSize, workers: int) -> float:
    """Slabs, their rows of the radiographs, and the radiographs that the worker reads for all."""
    if not size.views:
        return 0.0
    slabs = len(slab_bounds(size.volume))
    busy = min(workers, slabs)
    pixels = BYTES_OF_NUMBER * float(size.views) * size.rows * size.columns
    slab = COPIES_OF_SLAB * BYTES_OF_NUMBER * math.prod(size.volume) / slabs
    return math.ceil(slabs / busy) * (slab + SHARE_OF_ROWS * pixels / slabs) + pixels / busy


def _of_grains(size: ScanSize, workers: int) -> float:
    """Grains: each worker has all of them, or its part of a large sample."""
    voxels = float(math.prod(size.volume))
    few, many = BYTES_PER_VOXEL_OF_FEW * voxels, BYTES_OF_MANY + BYTES_PER_VOXEL_OF_MANY * voxels
    return min(few, many) / (workers if worth_sharing(voxels) else 1)
