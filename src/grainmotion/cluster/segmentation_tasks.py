"""Cutting grains out of a volume on finer voxels, some grains a task; workers read their crops from the shelf."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grainmotion.cluster.executor import Executor
from grainmotion.cluster.shared_store import SharedStore
from grainmotion.model.volume import Volume
from grainmotion.segmentation.label_refinement import Box, Boxed, Fine, fine_cut, placed, surroundings

TOGETHER = 4
"""Grains of a task."""


def cut_scattered(
    work: Executor,
    shelf: SharedStore,
    volume: Volume,
    labels: NDArray[np.integer],
    wanted: list[Boxed],
    factor: int,
    reach: float,
) -> Iterator[Volume | None]:
    """As `label_refinement.fine_grains`, by the workers."""
    crops = [(label, surroundings(box, volume.shape, reach)) for label, box in wanted]
    groups = [crops[k : k + TOGETHER] for k in range(0, len(crops), TOGETHER)]
    with shelf.lent((volume.array, labels)) as (array, labelled):
        tasks = [
            work.task(fine_cuts, paths=(array.path, labelled.path), crops=group, factor=factor, reach=reach)
            for group in groups
        ]
        found = [cut for cuts in work.results(tasks) for cut in cuts]
    for (_, around), cut in zip(crops, found, strict=True):
        yield None if cut is None else placed(cut, volume, around, factor)


def fine_cuts(paths: tuple[Path, Path], crops: list[tuple[int, Box]], factor: int, reach: float) -> list[Fine | None]:
    """What a worker does: some grains, from the files of volume and labels."""
    array, labels = (np.load(path, mmap_mode="r") for path in paths)
    return [fine_cut(_read(array, a), _read(labels, a), label, factor, reach) for label, a in crops]


def _read(array: Any, around: Box) -> NDArray[Any]:
    return np.array(array[around])
