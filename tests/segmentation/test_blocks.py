"""Segmentation in blocks (`segmentation.blocks`): the same labels whatever blocks and threads; exact filters."""

from __future__ import annotations

import time

import numpy as np
import pytest
from scipy import ndimage

from grainmotion.kernels.block_filters import erode_block, range_block, smooth_block, sum_block
from grainmotion.model.volume import Volume
from grainmotion.segmentation import blocks
from grainmotion.segmentation.blocks import Block, Work, blocks_of
from grainmotion.segmentation.level_codes import gaussian_weights
from grainmotion.segmentation.segment import segment

SHAPE = (37, 45, 53)
BALLS = ((14, 14, 14, 11), (14, 31, 16, 9), (24, 21, 34, 12), (17, 36, 39, 8), (29, 9, 9, 6))
SMALL = {"EDGES": (11, 13, 17), "SLAB_VOXELS": 7000}
ONE = {"EDGES": (64, 64, 256), "SLAB_VOXELS": 1 << 22}


def scanned(liquid=0.0, kind=np.float32):
    """Balls that touch, in a cylinder of liquid, blurred, with noise."""
    z, y, x = np.indices(SHAPE, dtype=float)
    share = np.zeros(SHAPE)
    for cz, cy, cx, r in BALLS:
        distance = np.sqrt((z - cz) ** 2 + (y - cy) ** 2 + (x - cx) ** 2)
        share = np.maximum(share, np.clip(r - distance + 0.5, 0, 1))
    array = share + liquid * (1 - share) * (np.hypot(y - 22, x - 26) < 21)
    noisy = ndimage.gaussian_filter(array, 0.8) + np.random.default_rng(0).normal(0, 0.05, SHAPE)
    return Volume(np.clip(noisy, 0, None).astype(kind), 0.1)


@pytest.mark.parametrize(("liquid", "kind"), [(0.0, np.float32), (0.0, np.float64), (0.4, np.float32)])
def test_labels_do_not_depend_on_blocks_and_threads(monkeypatch, liquid, kind):
    volume, found = scanned(liquid, kind), []
    for cut, threads in ((ONE, 1), (SMALL, 1), (SMALL, 4)):
        for name, value in cut.items():
            monkeypatch.setattr(blocks, name, value)
        monkeypatch.setattr(blocks.numba, "get_num_threads", lambda threads=threads: threads)
        found.append(segment(volume))
    assert found[0].labels.max() == len(BALLS)
    for other in found[1:]:
        np.testing.assert_array_equal(other.labels, found[0].labels)
        assert (other.threshold, other.border, other.phases) == (
            found[0].threshold,
            found[0].border,
            found[0].phases,
        )


def test_a_slice_of_one_plane_is_segmented():
    labels = segment(Volume(scanned().array[17:18], 0.1)).labels
    assert labels.shape == (1, *SHAPE[1:])
    assert labels.max() >= 3


@pytest.mark.parametrize("edges", [(64, 64, 256), (11, 13, 17)])
def test_filters_of_blocks_are_those_of_the_volume(monkeypatch, edges):
    monkeypatch.setattr(blocks, "EDGES", edges)
    array, weights = scanned().array, gaussian_weights(1.0)
    solid = array > 0.5
    smooth, spread, mean = (np.empty(SHAPE, np.float32) for _ in range(3))
    eroded = np.empty(SHAPE, bool)
    for block in blocks_of(SHAPE):
        smooth[block.box] = smooth_block(block.gather(array, len(weights) - 1), weights)
        spread[block.box] = range_block(block.gather(array, 1))
        mean[block.box] = sum_block(block.gather(array, 4), 9) / 729
        eroded[block.box] = erode_block(block.gather(solid, 1, 0, np.uint8))
    np.testing.assert_array_equal(smooth, ndimage.gaussian_filter(array, 1.0))
    np.testing.assert_array_equal(spread, ndimage.maximum_filter(array, 3) - ndimage.minimum_filter(array, 3))
    np.testing.assert_allclose(mean, ndimage.uniform_filter(array, 9), atol=1e-6)
    np.testing.assert_array_equal(eroded, ndimage.binary_erosion(solid))


def test_blocks_fill_a_box_and_look_beyond_it():
    whole = np.arange(np.prod(SHAPE)).reshape(SHAPE)
    box = (slice(3, 30), slice(0, 45), slice(50, 53))
    seen = np.zeros(SHAPE, int)
    for block in blocks_of(SHAPE, box):
        seen[block.box] += 1
        np.testing.assert_array_equal(block.gather(whole, 0, 0, np.int64), whole[block.box])
    assert seen[box].all()
    assert seen.sum() == seen[box].sum()
    corner = Block((0, 0, 0), (2, 2, 2))
    np.testing.assert_array_equal(corner.gather(whole, 2, None, np.int64), np.pad(whole, 2, "symmetric")[:6, :6, :6])


class TestWork:
    def test_results_are_in_order(self):
        work = Work(threads=3)
        assert work.each(range(20), lambda k: k * k) == [k * k for k in range(20)]
        assert sum(work.gathered(list(range(20)), lambda: 0, lambda k, total: total + k)) == 190
        assert work.each([], lambda k: k) == []

    def test_progress_rises_to_the_whole(self):
        told = []
        work = Work(lambda *report: told.append(report), threads=2)
        work.begin("first", 40, 1)
        work.each(range(6), lambda _: time.sleep(0.25))
        work.begin("second", 90, 2)
        work.end("done")
        done = [d for _, d, _ in told]
        assert done == sorted(done)
        assert {t for _, _, t in told} == {blocks.PERCENT}
        assert told[0] == ("first", 0, 100)
        assert any(0 < d < 40 for d in done)
        assert told[-2:] == [("second", 40, 100), ("done", 100, 100)]

    def test_an_error_of_a_thread_is_raised(self):
        with pytest.raises(ZeroDivisionError):
            Work(threads=2).each(range(4), lambda k: 1 // (k - 2))
