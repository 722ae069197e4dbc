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
from grainmotion.segmentation.label_growth import grown_labels
from grainmotion.segmentation.labels import CleanLabels

EDGE, PERIOD, RADIUS = 96, 16, 6.5
"""Voxels of the volume's edge, of the distance between grains, and of a grain's radius."""
VOXEL = 0.1

# Bytes a voxel at the peak.  A plane is a hundredth of this volume, 64 planes are two thirds of it.
MAX_BYTES = {
    "sizes of the grains": 0.2,
    "fragments": 0.3,
    "shapes of the grains": 0.4,
    "label of the background": 0.2,
    "specks of labels": 0.2,
    "attenuation without a label": 17.0,
    "bodies beside the grains": 22.0,
    "beam hardening": 14.5,
}


@cache
def sample() -> tuple[Volume, np.ndarray]:
    """Balls on a grid, with noise, and their labels."""
    place = np.indices((EDGE,) * 3, dtype=np.float32)
    cell = (place // PERIOD).astype(np.int32)
    inside = ((place % PERIOD - (PERIOD - 1) / 2) ** 2).sum(axis=0) < RADIUS**2
    count = -(-EDGE // PERIOD)
    labels = np.where(inside, 1 + (cell[0] * count + cell[1]) * count + cell[2], 0).astype(np.int32)
    noise = np.random.default_rng(0).normal(0, 0.02, labels.shape)
    return Volume((0.5 * inside + noise).astype(np.float32), VOXEL), labels


@cache
def scan() -> Scan:
    """Radiographs of the sample."""
    views = Geometry.parallel(np.arange(24) * 7.5, (EDGE, 144), VOXEL)
    return Scan(project(sample()[0], views), views)


def pistons(volume: Volume, labels: np.ndarray) -> None:
    """Two bodies, each an eighth of the volume."""
    array, grains = volume.array, labels.copy()
    array = array.copy()
    for part in (slice(None, EDGE // 8), slice(-EDGE // 8, None)):
        array[part], grains[part] = 1.0, 0
    beyond = grown_labels(grains, 1.5) == 0
    tracemalloc.reset_peak()
    assert len(find_bodies(Volume(array, VOXEL), grains, beyond)[1]) == 2


WORK = {
    "sizes of the grains": lambda volume, labels: check_grain_sizes(labels),
    "fragments": lambda volume, labels: check_fragments(volume, labels, 0.25),
    "shapes of the grains": lambda volume, labels: check_grain_shapes(labels),
    "label of the background": background_label,
    "specks of labels": lambda volume, labels: CleanLabels.of(labels),
    "attenuation without a label": check_unlabelled,
    "bodies beside the grains": pistons,
    "beam hardening": lambda volume, labels: check_hardening(scan(), volume, labels),
}


@pytest.mark.parametrize("name", MAX_BYTES)
def test_memory_of_work_on_a_volume(name):
    volume, labels = sample()
    scan()
    tracemalloc.start()
    WORK[name](volume, labels)
    counted = tracemalloc.get_traced_memory()[1] / labels.size
    tracemalloc.stop()
    print(f"{name}: {counted:.2f} bytes a voxel, bound {MAX_BYTES[name]:g}")
    assert counted <= MAX_BYTES[name]
