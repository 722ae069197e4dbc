"""Tasks that extract grains from a volume on finer voxels; workers read their crops from files."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TypeVar, cast

import numpy as np
from numpy.typing import NDArray

from grainmotion.cluster.executor import Executor
from grainmotion.cluster.shared_store import SharedStore
from grainmotion.model.volume import Volume
from grainmotion.segmentation.label_refinement import (
    Box,
    Boxed,
    FineVolume,
    GrownLabels,
    Keep,
    Upsampling,
    surroundings,
)

Number = TypeVar("Number", bound=np.generic)

GRAINS_PER_TASK = 8
"""A task costs the client and the scheduler some milliseconds, cutting a grain ten."""


def extract_distributed(
    executor: Executor,
    store: SharedStore,
    volume: Volume,
    owners: GrownLabels,
    wanted: list[Boxed],
    factor: int,
    keep: Keep,
) -> Iterator[FineVolume | None]:
    """As `label_refinement.fine_grains`, by the workers."""
    upsampling = Upsampling(factor, owners.reach, volume.voxel_size, volume.origin, keep)
    crops = [(label, surroundings(box, volume.shape, owners.reach)) for label, box in wanted]
    groups = [crops[k : k + GRAINS_PER_TASK] for k in range(0, len(crops), GRAINS_PER_TASK)]
    with store.temporary((volume.array, owners.labels, owners.grown)) as stored:
        paths = tuple(array.path for array in stored)
        tasks = (executor.task(kept_grains, paths=paths, crops=group, upsampling=upsampling) for group in groups)
        for kept in cast("Iterator[list[FineVolume | None]]", executor.in_order(tasks)):
            yield from kept


def kept_grains(
    paths: tuple[Path, ...], crops: list[tuple[int, Box]], upsampling: Upsampling
) -> list[FineVolume | None]:
    """What is kept of some grains, from the files of the volume, its labels and these grown."""
    array, labels, grown = (np.load(path, mmap_mode="r") for path in paths)
    return [upsampling.kept((_read(array, a), _read(labels, a), _read(grown, a)), label, a) for label, a in crops]


def _read(array: NDArray[Number], around: Box) -> NDArray[Number]:
    return np.array(array[around])
