"""Tasks that extract grains from a volume on finer voxels; workers read their crops from files."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TypeVar, cast

import numpy as np
from numpy.typing import NDArray

from grainmotion.cluster.executor import Executor
from grainmotion.cluster.shared_store import SharedStore, StoredImages
from grainmotion.model.grains import Grain
from grainmotion.model.volume import Volume
from grainmotion.segmentation.grain_cutting import Boxed, CutSettings, cut_grain, needed, placed_crop
from grainmotion.segmentation.label_refinement import Box

Number = TypeVar("Number", bound=np.generic)

GRAINS_PER_TASK = 8
"""A task costs the client and the scheduler some milliseconds, cutting a grain ten."""
MAX_KEPT_BYTES = 1 << 30
"""Of a volume, or of its labels: the client alone checks larger ones, so that nobody needs their files again."""


def extract_distributed(
    executor: Executor,
    store: SharedStore,
    volume: Volume,
    labels: NDArray[np.integer],
    boxes: list[Boxed],
    settings: CutSettings,
) -> Iterator[Grain | None]:
    """As `grain_cutting.cut_grains`, by the workers; checks that follow take the same files of volume and labels."""
    crops = [(label, needed(box, volume.shape, settings)) for label, box in boxes]
    groups = [crops[k : k + GRAINS_PER_TASK] for k in range(0, len(crops), GRAINS_PER_TASK)]
    with _stored(store, (volume.array, labels)) as stored:
        paths, place = tuple(array.path for array in stored), (volume.origin, volume.voxel_size)
        tasks = (executor.task(cut_some, paths=paths, place=place, crops=crops, settings=settings) for crops in groups)
        found = cast("Iterator[list[Grain | None]]", executor.in_order(tasks))
        for grains in found:
            yield from grains


@contextmanager
def _stored(store: SharedStore, arrays: tuple[NDArray[np.generic], ...]) -> Iterator[list[StoredImages]]:
    """Volume and labels in files, which are removed at the end of the context, or, if they are small, when the arrays
    are no longer used."""
    if all(array.nbytes <= MAX_KEPT_BYTES for array in arrays):
        yield [store.keep(array) for array in arrays]
        return
    with store.temporary(arrays) as stored:
        yield stored


def cut_some(
    paths: tuple[Path, ...],
    place: tuple[NDArray[np.float64], float],
    crops: list[tuple[int, Box]],
    settings: CutSettings,
) -> list[Grain | None]:
    """Some grains, from the files of the volume and its labels; ``place`` is the volume's origin and voxel size."""
    array, labels = (np.load(path, mmap_mode="r") for path in paths)
    grains = list[Grain | None]()
    for label, box in crops:
        around = placed_crop(_read(array, box), *place, box)
        grains.append(cut_grain(around, _read(labels, box), label, settings))
    return grains


def _read(array: NDArray[Number], around: Box) -> NDArray[Number]:
    return np.array(array[around])
