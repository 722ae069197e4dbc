"""Grains cut one by one (`segmentation.grain_cutting`): what they depend on, threads, compact voxels."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import ndimage

from grainmotion.model.compact_volume import CompactVolume
from grainmotion.model.volume import Volume
from grainmotion.segmentation import extraction
from grainmotion.segmentation.extraction import extract_grains
from grainmotion.segmentation.grain_cutting import CutSettings, cut_grain, cut_grains, needed
from grainmotion.segmentation.label_growth import grown_slabs
from grainmotion.segmentation.segment import Segmentation

SETTINGS = CutSettings(reach=3.0, upsampling=2)


def packing(seed=0, shape=(40, 38, 44)):
    """Noisy attenuation, and labels of blobs that touch each other and the volume's sides."""
    rng = np.random.default_rng(seed)
    places = rng.uniform(0, 1, (20, 3)) * shape
    distances = np.stack([np.linalg.norm(np.moveaxis(np.indices(shape), 0, -1) - p, axis=-1) for p in places])
    labels = np.where(distances.min(axis=0) < 8, distances.argmin(axis=0) + 1, 0).astype(np.int32)
    array = ndimage.gaussian_filter((labels > 0).astype(np.float32), 0.8) + rng.normal(0, 0.02, shape)
    return Volume(array.astype(np.float32), 0.1, (1.0, -2.0, 3.0)), labels


def boxes_of(labels):
    return [(k, box) for k, box in enumerate(ndimage.find_objects(labels), start=1) if box is not None]


def same(one, other):
    assert (one is None) == (other is None)
    if one is not None:
        assert one.label == other.label
        np.testing.assert_allclose(one.center, other.center, rtol=0, atol=1e-12)
        for a, b in ((one.volume, other.volume), (one.fine, other.fine)):
            np.testing.assert_array_equal(a.array, b.array)
            np.testing.assert_allclose(a.center, b.center, rtol=0, atol=1e-12)


def test_a_grain_depends_on_its_surroundings_alone():
    """Beyond them, voxels and labels may be anything."""
    volume, labels = packing()
    rng = np.random.default_rng(1)
    for label, box in boxes_of(labels):
        around = needed(box, volume.shape, SETTINGS)
        other, others = rng.uniform(size=volume.shape).astype(np.float32), rng.integers(100, 110, volume.shape)
        other[around], others[around] = volume.array[around], labels[around]
        found = [cut_grains(*case, [(label, box)], SETTINGS) for case in (
            (volume, labels), (replace(volume, array=other), others.astype(np.int32)),
        )]  # fmt: skip
        same(*map(next, found))


def test_a_larger_crop_gives_the_same_grain():
    volume, labels = packing(2)
    for (label, _), grain in zip(boxes_of(labels), cut_grains(volume, labels, boxes_of(labels), SETTINGS), strict=True):
        same(grain, cut_grain(volume, labels, label, SETTINGS))


@pytest.mark.parametrize("reach", [0.0, 1.5, 3.0])
def test_own_voxels_are_those_that_the_label_grows_to(reach):
    volume, labels = packing(3)
    grown = np.concatenate([part.copy() for _, part in grown_slabs(labels, reach)])
    total = np.zeros(volume.shape)
    for grain in cut_grains(volume, labels, boxes_of(labels), CutSettings(reach)):
        assert grain.fine is None
        first = np.rint((grain.volume.origin - volume.origin) / volume.voxel_size).astype(int)[::-1]
        own = np.argwhere(grain.volume.array != 0) + first
        assert (grown[tuple(own.T)] == grain.label).all()
        total[tuple(own.T)] += grain.volume.array[grain.volume.array != 0]
    np.testing.assert_array_equal(total, np.where(grown > 0, volume.array, 0))


def test_grains_do_not_depend_on_the_number_of_threads(monkeypatch):
    volume, labels = packing(4)
    found = []
    for threads in (1, 3):
        monkeypatch.setattr("numba.get_num_threads", lambda threads=threads: threads)
        found.append(list(cut_grains(volume, labels, boxes_of(labels), SETTINGS)))
    assert len(found[0]) == len(boxes_of(labels))
    for one, other in zip(*found, strict=True):
        same(one, other)


def test_a_label_without_attenuation_is_no_grain():
    volume, labels = packing(5)
    empty = replace(volume, array=np.where(labels == 2, 0, volume.array) * (labels > 0))
    settings = CutSettings(0.0, 2)
    assert (labels == 2).any()
    for (label, _), grain in zip(boxes_of(labels), cut_grains(empty, labels, boxes_of(labels), settings), strict=True):
        assert (grain is None) == (label == 2)


def test_many_grains_are_kept_compactly(monkeypatch):
    """Coarse and finer voxels: those of the same grains, rounded."""
    volume, labels = packing(6)
    segmentation = Segmentation.of(labels)
    whole = extract_grains(volume, segmentation)
    monkeypatch.setattr(extraction, "MAX_CUT_BYTES", 0)
    compact = extract_grains(volume, segmentation)
    assert compact.precision == np.float32
    for one, other in zip(whole, compact, strict=True):
        assert other.center.tolist() == one.center.tolist()
        for kept, exact in ((other.volume, one.volume), (other.fine, one.fine)):
            assert isinstance(kept, CompactVolume)
            np.testing.assert_array_equal(kept.array, CompactVolume.of(exact).array)
        np.testing.assert_array_equal(other.coarse_volume.array, other.volume.array)
        np.testing.assert_array_equal(other.fine_volume.array, other.fine.array)
