"""Memory that work on a whole volume needs beside the volume and its labels, counted, not timed.

Scans of a user's size leave about ten bytes a voxel for it (decision 0054).  Each bound lies about an eighth above what
was counted; `pytest tests/work -rP` prints what is counted now.
"""

import tracemalloc
from functools import cache

import numpy as np
import pytest

from grainmotion.diagnosis.grain_shapes import check_grain_shapes
from grainmotion.diagnosis.hardening import check_hardening
from grainmotion.diagnosis.label_background import background_label
from grainmotion.diagnosis.unlabelled import check_fragments, check_grain_sizes, check_unlabelled
from grainmotion.model.geometry import Geometry
from grainmotion.model.scan import Scan
from grainmotion.model.volume import Volume
from grainmotion.projection.volumes import project
from grainmotion.segmentation.bodies import find_bodies
from grainmotion.segmentation.fluid import find_fluid
from grainmotion.segmentation.label_growth import out_of_reach
from grainmotion.segmentation.labels import CleanLabels

SHAPE, PERIOD, RADIUS = (384, 48, 48), 16, 6.5
"""Voxels of the volume, which is high, so that slabs are a small part of it; of the distance between grains, and of a
grain's radius."""
VOXEL = 0.1

# Bytes a voxel at the peak.
MAX_BYTES = {
    "sizes of the grains": 0.05,
    "fragments": 0.06,
    "shapes of the grains": 0.1,
    "label of the background": 0.05,
    "specks of labels": 0.1,
    "attenuation without a label": 7.3,
    "beam hardening": 12.0,
    "bodies beside the grains": 11.3,
    "liquid": 20.0,
}


@cache
def sample() -> tuple[Volume, np.ndarray]:
    """Balls on a grid, with noise, and their labels."""
    place = np.indices(SHAPE, dtype=np.float32)
    cell = (place // PERIOD).astype(np.int32)
    inside = ((place % PERIOD - (PERIOD - 1) / 2) ** 2).sum(axis=0) < RADIUS**2
    labels = np.where(inside, 1 + (cell[0] * 3 + cell[1]) * 3 + cell[2], 0).astype(np.int32)
    noise = np.random.default_rng(0).normal(0, 0.02, SHAPE)
    return Volume((0.5 * inside + noise).astype(np.float32), VOXEL), labels


@cache
def scan() -> Scan:
    """Radiographs of the sample."""
    views = Geometry.parallel(np.arange(24) * 7.5, (SHAPE[0] // 2, 36), 2 * VOXEL)
    return Scan(project(sample()[0], views), views)


@cache
def between_pistons() -> tuple[Volume, np.ndarray, np.ndarray]:
    """The sample with a body at each end, an eighth of its height, and what is beyond the grains."""
    volume, labels = sample()
    array, grains = volume.array.copy(), labels.copy()
    for part in (slice(None, SHAPE[0] // 8), slice(-SHAPE[0] // 8, None)):
        array[part], grains[part] = 1.0, 0
    return Volume(array, VOXEL), grains, out_of_reach(grains, 1.5)


@cache
def wet() -> Volume:
    """The sample with a liquid up to three quarters of its height."""
    volume, labels = sample()
    height = np.arange(SHAPE[0])[:, None, None]
    return Volume(volume.array + np.float32(0.15) * ((labels == 0) & (height < 0.75 * SHAPE[0])), VOXEL)


def bodies() -> None:
    """Find both bodies."""
    assert len(find_bodies(*between_pistons())[1]) == 2


def liquid() -> None:
    """Find the liquid."""
    assert find_fluid(wet(), sample()[1]) is not None


WORK = {
    "sizes of the grains": lambda: check_grain_sizes(sample()[1]),
    "fragments": lambda: check_fragments(*sample(), 0.25),
    "shapes of the grains": lambda: check_grain_shapes(sample()[1]),
    "label of the background": lambda: background_label(*sample()),
    "specks of labels": lambda: CleanLabels.of(sample()[1]),
    "attenuation without a label": lambda: check_unlabelled(*sample()),
    "beam hardening": lambda: check_hardening(scan(), *sample()),
    "bodies beside the grains": bodies,
    "liquid": liquid,
}


@pytest.mark.parametrize("name", MAX_BYTES)
def test_memory_of_work_on_a_volume(name):
    _ = sample(), scan(), between_pistons(), wet()
    tracemalloc.start()
    WORK[name]()
    counted = tracemalloc.get_traced_memory()[1] / sample()[1].size
    tracemalloc.stop()
    print(f"{name}: {counted:.2f} bytes a voxel, bound {MAX_BYTES[name]:g}")
    assert counted <= MAX_BYTES[name]
