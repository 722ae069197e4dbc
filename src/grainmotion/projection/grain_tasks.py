"""Functions of single grains, part of the sample by part: by the backend that holds the voxels, or shared out."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from typing import Protocol, TypeVar

import numpy as np

from grainmotion._typing import Float, Image
from grainmotion.backends.cpu import CPU
from grainmotion.model.pose import Pose
from grainmotion.model.task_map import each, is_shared
from grainmotion.projection.grain_arrays import GrainArrays

ROWS_OF_A_TASK = 64
"""Rows of a table of grains that are one task: of 800 grains some seconds of work, where a task costs milliseconds."""

Setup = TypeVar("Setup")
OfGrains = Callable[[GrainArrays, Pose, tuple[Image, ...], Setup], Float]


class MapGrains(Protocol):
    """As `PatchBackend.map_grains`."""

    def __call__(
        self, function: OfGrains[Setup], grains: GrainArrays, pose: Pose, images: tuple[Image, ...], settings: Setup, /
    ) -> Float: ...


def mapper_of(grains: GrainArrays) -> MapGrains:
    """What calls ``function(grains, pose, images, setup)``, a row a grain, each of which depends on its grain alone.

    Workers that share a run share the grains as well (`model.task_map`), also where the CPU projects them.
    """
    return _map_shared if grains.backend is CPU and is_shared() else grains.backend.map_grains


def _map_shared(
    function: OfGrains[Setup], grains: GrainArrays, pose: Pose, images: tuple[Image, ...], setup: Setup
) -> Float:
    return np.concatenate(each(partial(_of_part, function, images, setup), _parts(grains, pose)))


def _parts(grains: GrainArrays, pose: Pose) -> Iterator[tuple[GrainArrays, Pose]]:
    for k in range(0, len(grains), ROWS_OF_A_TASK):
        rows = np.arange(k, min(k + ROWS_OF_A_TASK, len(grains)))
        yield grains.alone(rows), pose.moved(pose.translations[rows], pose.matrices[rows])


def _of_part(
    function: OfGrains[Setup], images: tuple[Image, ...], setup: Setup, part: tuple[GrainArrays, Pose]
) -> Float:
    return function(*part, images, setup)
