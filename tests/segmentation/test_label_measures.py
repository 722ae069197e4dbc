"""Measures of labels, against those of scipy."""

import numpy as np
import pytest
from scipy import ndimage

from grainmotion.segmentation import blocks, label_measures


@pytest.mark.parametrize("dtype", [np.uint8, np.int32, np.int64])
@pytest.mark.parametrize("slab", [1, 100, 1 << 22])
def test_boxes_are_those_of_scipy(dtype: type, slab: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(blocks, "SLAB_VOXELS", slab)
    labels = np.random.default_rng(3).choice([0, 0, 0, 1, 2, 5, 9], (7, 6, 5)).astype(dtype)
    labels[3:] = np.where(labels[3:] == 9, 0, labels[3:])
    assert label_measures.boxes_of_labels(labels) == ndimage.find_objects(labels)


def test_no_labels_have_no_boxes() -> None:
    assert label_measures.boxes_of_labels(np.zeros((3, 4, 5), np.int32)) == []
