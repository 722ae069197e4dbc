"""Labels grown by a distance: as by a distance transform, but for labels equally near."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import ndimage

from grainmotion.segmentation import label_growth
from grainmotion.segmentation.label_growth import grown_labels


def scattered(shape=(23, 17, 29), seed=0):
    rng = np.random.default_rng(seed)
    labels = np.zeros(shape, np.int32)
    for label in range(1, 12):
        z, y, x = (int(rng.integers(0, n)) for n in shape)
        labels[z : z + 3, y : y + 4, x : x + 2] = label
    return labels


@pytest.mark.parametrize("reach", [1.0, 1.5, 3.0])
def test_each_voxel_in_reach_gets_one_of_the_nearest_labels(reach):
    labels = scattered()
    grown = grown_labels(labels, reach)
    distances = {k: ndimage.distance_transform_edt(labels != k) for k in np.unique(labels[labels > 0])}
    nearest = np.min(list(distances.values()), axis=0)
    assert ((grown > 0) == (nearest <= reach)).all()
    for label, distance in distances.items():
        assert (distance[grown == label] == nearest[grown == label]).all()
    assert (grown[labels > 0] == labels[labels > 0]).all()


def test_nothing_grows_by_less_than_a_voxel():
    labels = scattered()
    assert grown_labels(labels, 0.0) is labels
    assert grown_labels(labels, 0.9) is labels


def test_planes_taken_together_do_not_matter_and_are_told(monkeypatch):
    labels, told = scattered(seed=1), []
    whole = grown_labels(labels, 3.0)
    monkeypatch.setattr(label_growth, "VOXELS_GROWN_TOGETHER", 5 * labels[0].size)
    parts = grown_labels(labels, 3.0, lambda message, done, total: told.append((done, total)))
    assert (parts == whole).all()
    assert told == [(0, 23), (5, 23), (10, 23), (15, 23), (20, 23)]


def test_a_slice_of_one_plane():
    labels = np.zeros((1, 5, 7), np.uint16)
    labels[0, 2, 3] = 4
    grown = grown_labels(labels, 1.0)
    assert grown.dtype == np.uint16
    assert np.count_nonzero(grown == 4) == 5
