"""Labels grown by a distance: as by a distance transform, but for labels equally near."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import ndimage

from grainmotion.segmentation import label_growth
from grainmotion.segmentation.label_growth import grown_crop, grown_slabs, out_of_reach, owned_by


def scattered(shape=(23, 17, 29), seed=0):
    rng = np.random.default_rng(seed)
    labels = np.zeros(shape, np.int32)
    for label in range(1, 12):
        z, y, x = (int(rng.integers(0, n)) for n in shape)
        labels[z : z + 3, y : y + 4, x : x + 2] = label
    return labels


def grown_labels(labels, reach):
    return np.concatenate([part.copy() for _, part in grown_slabs(labels, reach)])


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


@pytest.mark.parametrize("reach", [0.0, 0.9])
def test_nothing_grows_by_less_than_a_voxel(reach):
    labels = scattered()
    assert (grown_labels(labels, reach) == labels).all()
    assert (grown_crop(labels, reach, np.s_[2:5, 3:9, 1:7]) == labels[2:5, 3:9, 1:7]).all()


def test_slabs_do_not_matter(monkeypatch):
    labels = scattered(seed=1)
    whole = grown_labels(labels, 3.0)
    monkeypatch.setattr(label_growth, "PLANES_GROWN_TOGETHER", 5)
    parts = list(grown_slabs(labels, 3.0))
    assert [(planes.start, planes.stop) for planes, _ in parts] == [(0, 5), (5, 10), (10, 15), (15, 20), (20, 23)]
    assert (grown_labels(labels, 3.0) == whole).all()
    assert (out_of_reach(labels, 3.0) == (whole == 0)).all()
    assert (owned_by(labels, 3.0, 4) == (whole == 4)).all()
    assert (whole == 4).any()


@pytest.mark.parametrize("box", [np.s_[0:23, 0:17, 0:29], np.s_[4:9, 0:17, 11:12], np.s_[20:23, 5:6, 0:29]])
def test_a_box_is_grown_as_the_whole(box):
    labels = scattered(seed=2)
    assert (grown_crop(labels, 3.0, box) == grown_labels(labels, 3.0)[box]).all()


def test_empty_planes_and_lines_stay_empty():
    labels = np.zeros((40, 30, 35), np.int32)
    labels[20:22, 10:12, 14:16] = 1
    grown = grown_labels(labels, 2.0)
    assert np.count_nonzero(grown.any(axis=(1, 2))) == 6
    assert np.count_nonzero(grown.any(axis=(0, 2))) == 6
    assert np.count_nonzero(grown.any(axis=(0, 1))) == 6
    assert not grown_labels(np.zeros_like(labels), 2.0).any()


def test_a_slice_of_one_plane():
    labels = np.zeros((1, 5, 7), np.uint16)
    labels[0, 2, 3] = 4
    grown = grown_labels(labels, 1.0)
    assert grown.dtype == np.uint16
    assert np.count_nonzero(grown == 4) == 5
