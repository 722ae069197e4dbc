"""Grains extracted by tasks equal those extracted in one process."""

import gc
from functools import partial

import numpy as np
import pytest

from grainmotion.cluster import segmentation_tasks
from grainmotion.cluster.segmentation_tasks import extract_distributed
from grainmotion.cluster.shared_calls import call_each
from grainmotion.cluster.shared_store import SharedStore
from grainmotion.model.compact_volume import CompactVolume
from grainmotion.model.volume import Volume
from grainmotion.segmentation import extraction
from grainmotion.segmentation.extraction import grains_from_labels
from inline_executor import InlineExecutor


def total_of(volume, labels):
    return float((volume.array * labels).sum())


@pytest.mark.parametrize("compact", [False, True])
def test_distributed_extraction_gives_the_same_grains(tmp_path, monkeypatch, compact):
    monkeypatch.setattr(extraction, "MAX_CUT_BYTES", 0 if compact else 1 << 28)
    monkeypatch.setattr(segmentation_tasks, "GRAINS_PER_TASK", 4)
    rng = np.random.default_rng(0)
    labels = np.kron(np.arange(1, 9).reshape(2, 2, 2), np.ones((9, 9, 9), int))
    volume = Volume(rng.random(labels.shape, np.float32) + 0.5, 0.1, (1.0, 2.0, 3.0))
    executor, store = InlineExecutor(), SharedStore(tmp_path)
    one = grains_from_labels(volume, labels)
    many = grains_from_labels(volume, labels, cut=lambda *cut: extract_distributed(executor, store, *cut))
    assert executor.done == ["cut_some"] * 2
    for a, b in zip(one.grains, many.grains, strict=True):
        for found, expected in ((b.volume, a.volume), (b.fine, a.fine)):
            np.testing.assert_array_equal(found.array, expected.array)
            assert found.center == expected.center
            assert isinstance(found, CompactVolume) == compact
    del volume, labels
    gc.collect()
    assert not list(store.folder.iterdir())


@pytest.mark.parametrize("small", [True, False])
def test_calls_that_follow_take_the_files_of_small_volumes(tmp_path, monkeypatch, small):
    monkeypatch.setattr(segmentation_tasks, "MAX_KEPT_BYTES", 1 << 30 if small else 0)
    labels = np.kron(np.arange(1, 9).reshape(2, 2, 2), np.ones((12, 12, 12), np.int32))
    volume = Volume(np.ones(labels.shape, np.float32), 0.1)
    executor, store = InlineExecutor(), SharedStore(tmp_path)
    grains_from_labels(volume, labels, cut=lambda *cut: extract_distributed(executor, store, *cut))
    assert len(list(store.folder.iterdir())) == (2 if small else 0)
    write, written = SharedStore.write, []

    def noted(store, array):
        written.append(array)
        return write(store, array)

    monkeypatch.setattr(SharedStore, "write", noted)
    assert call_each(executor, store, partial(total_of, volume), [labels, labels]) == [labels.sum()] * 2
    assert len(written) == (0 if small else 2)
    assert len(list(store.folder.iterdir())) == (2 if small else 0)
