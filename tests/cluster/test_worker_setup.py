"""Dask knows how large our records are: it spills and counts by these sizes."""

from dataclasses import replace

import numpy as np
import pytest

from few_grains import grain_set
from grainmotion.cluster.worker_setup import register
from grainmotion.model.compact_volume import CompactVolume
from grainmotion.model.volume import Volume

sizeof = pytest.importorskip("dask.sizeof").sizeof


@pytest.mark.parametrize("compact", [False, True])
def test_grains_have_the_size_of_their_voxels(compact):
    register()
    grains = list(grain_set().grains[:4])
    if compact:
        grains = [replace(grain, fine=CompactVolume.of(_single(grain.fine))) for grain in grains]
    held = sum(
        grain.volume.array.nbytes + (grain.fine.nbytes if compact else grain.fine.array.nbytes) for grain in grains
    )
    assert held <= sizeof(grains) < 1.1 * held + 5_000


def _single(volume):
    return Volume(volume.array.astype(np.float32), volume.voxel_size, volume.center)
