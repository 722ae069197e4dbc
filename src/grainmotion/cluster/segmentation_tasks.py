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
from grainmotion.segmentation.label_refinement import Box, Boxed, Fine, GrownLabels, fine_cut, placed, surroundings

Number = TypeVar("Number", bound=np.generic)

GRAINS_PER_TASK = 4


def extract_distributed(
    executor: Executor,
    store: SharedStore,
    volume: Volume,
    owners: GrownLabels,
    wanted: list[Boxed],
    factor: int,
) -> Iterator[Volume | None]:
    """As `label_refinement.fine_grains`, by the workers."""
    reach = owners.reach
    crops = [(label, surroundings(box, volume.shape, reach)) for label, box in wanted]
    groups = [crops[k : k + GRAINS_PER_TASK] for k in range(0, len(crops), GRAINS_PER_TASK)]
    with store.temporary((volume.array, owners.labels, owners.grown)) as stored:
        paths = tuple(array.path for array in stored)
        tasks = (executor.task(fine_cuts, paths=paths, crops=group, factor=factor, reach=reach) for group in groups)
        found = cast("Iterator[list[Fine | None]]", executor.in_order(tasks))
        for group, cuts in zip(groups, found, strict=True):
            for (_, around), cut in zip(group, cuts, strict=True):
                yield None if cut is None else placed(cut, volume, around, factor)


def fine_cuts(paths: tuple[Path, ...], crops: list[tuple[int, Box]], factor: int, reach: float) -> list[Fine | None]:
    """Some grains, from the files of the volume, its labels and these grown."""
    array, labels, grown = (np.load(path, mmap_mode="r") for path in paths)
    return [fine_cut(_read(array, a), _read(labels, a), _read(grown, a), label, factor, reach) for label, a in crops]


def _read(array: NDArray[Number], around: Box) -> NDArray[Number]:
    return np.array(array[around])
