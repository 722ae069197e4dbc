"""Grains cut out by others: the same grains."""

import numpy as np

from grainmotion.cluster.segmentation_tasks import extract_distributed
from grainmotion.cluster.shared_store import SharedStore
from grainmotion.model.volume import Volume
from grainmotion.segmentation.extraction import grains_from_labels
from inline_work import InlineExecutor


def test_same_grains(tmp_path):
    rng = np.random.default_rng(0)
    labels = np.kron(np.arange(1, 9).reshape(2, 2, 2), np.ones((9, 9, 9), int))
    volume = Volume(rng.random(labels.shape, np.float32) + 0.5, 0.1, (1.0, 2.0, 3.0))
    work, shelf = InlineExecutor(), SharedStore(tmp_path)
    one = grains_from_labels(volume, labels)
    many = grains_from_labels(volume, labels, cut=lambda *cut: extract_distributed(work, shelf, *cut))
    assert work.done == ["fine_cuts"] * 2
    for a, b in zip(one.grains, many.grains, strict=True):
        np.testing.assert_array_equal(b.fine.array, a.fine.array)
        assert b.fine.center == a.fine.center
        np.testing.assert_array_equal(b.volume.array, a.volume.array)
    assert not list(shelf.folder.iterdir())
