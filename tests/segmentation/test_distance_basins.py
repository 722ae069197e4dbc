"""Distances and their basins (`segmentation.distance_basins`), growth of labels (`flooding`), components, pairs."""

from __future__ import annotations

import itertools

import edt
import numpy as np
import pytest
from scipy import ndimage
from skimage.segmentation import watershed

from grainmotion.segmentation import blocks
from grainmotion.segmentation.blocks import Work
from grainmotion.segmentation.components import Components, fill_holes
from grainmotion.segmentation.distance_basins import distances, label_basins, largest_balls, nearest_codes
from grainmotion.segmentation.flooding import grow_labels
from grainmotion.segmentation.label_pairs import LabelPairs

SHAPE = (23, 31, 29)


@pytest.fixture(params=[1 << 22, 2000], autouse=True)
def _slabs(request, monkeypatch):
    monkeypatch.setattr(blocks, "SLAB_VOXELS", request.param)
    monkeypatch.setattr(blocks, "EDGES", (64, 64, 256) if request.param > 2000 else (9, 10, 11))


def rough(seed=0, share=0.45, sigma=1.5):
    """Connected pieces of noise."""
    noise = ndimage.gaussian_filter(np.random.default_rng(seed).normal(size=SHAPE), sigma)
    return noise.astype(np.float32), noise > np.quantile(noise, 1 - share)


def test_distances_are_exact():
    mask = rough()[1]
    np.testing.assert_array_equal(distances(mask, Work()), edt.edt(mask, parallel=1))
    plane = mask[:1]
    np.testing.assert_array_equal(distances(plane, Work()), edt.edt(plane, parallel=1))


def test_the_nearest_codes_are_at_the_nearest_voxels():
    noise, wanted = rough(share=0.1)
    codes = np.digitize(noise, np.quantile(noise, [0.92, 0.94, 0.96])).astype(np.int8)
    found = nearest_codes(codes, wanted, Work())
    for code in range(4):  # the nearest voxel of that code is as near as any
        own = ndimage.distance_transform_edt(~(wanted & (codes == code)))
        np.testing.assert_allclose(own[found == code], ndimage.distance_transform_edt(~wanted)[found == code])


def test_largest_balls():
    labels = np.zeros(SHAPE, np.int32)
    labels[2:9, 3:12, 4:17], labels[9:14, 3:12, 4:17] = 1, 3
    found = largest_balls(labels, 3, Work())
    np.testing.assert_array_equal(found[:3], [0, 4, 0])
    assert found[3] == edt.edt(labels == 3, parallel=1).max()


@pytest.mark.parametrize("share", [0.1, 0.45, 0.7])
def test_components_are_those_of_scipy(share):
    mask = rough(share=share)[1]
    found, expected = Components.of(mask, Work()), ndimage.label(mask)[0]
    labels = np.zeros(SHAPE, np.int32)
    found.paint(labels, np.arange(1, len(found.sizes) + 1), Work())
    np.testing.assert_array_equal(labels, expected)
    np.testing.assert_array_equal(found.sizes, np.bincount(expected.ravel())[1:])
    edge = np.ones(SHAPE, bool)
    edge[1:-1, 1:-1, 1:-1] = False
    np.testing.assert_array_equal(np.flatnonzero(found.at_border) + 1, np.unique(expected[edge & mask]))
    filled = mask.copy()
    fill_holes(filled, Work())
    np.testing.assert_array_equal(filled, ndimage.binary_fill_holes(mask))


def test_components_of_codes_are_of_one_code_each():
    codes = np.digitize(rough()[0], [-0.05, 0.05]).astype(np.uint8)
    found = Components.of(codes, Work())
    assert [np.count_nonzero(found.codes == code) for code in (1, 2)] == [ndimage.label(codes == c)[1] for c in (1, 2)]


def test_every_peak_has_a_basin_and_every_voxel_is_in_that_of_a_higher_neighbour():
    distance = distances(rough()[1], Work())
    basins = np.where(np.arange(SHAPE[2]) > 20, -7, 0) * (distance == 0)  # some that are set aside
    basins = np.ascontiguousarray(np.broadcast_to(basins, SHAPE), np.int32)
    peaks = label_basins(basins, distance, Work())
    tops = (distance == ndimage.maximum_filter(distance, 3)) & (distance > 0)
    assert basins.max() == len(peaks) - 1 == ndimage.label(tops, np.ones((3, 3, 3)))[1]
    np.testing.assert_array_equal(basins > 0, distance > 0)
    np.testing.assert_array_equal(peaks[1:], ndimage.maximum(distance, basins, np.arange(1, len(peaks))))
    padded, own = np.pad(distance, 1), np.pad(basins, 1)
    for z, y, x in np.argwhere((distance > 0) & ~tops):
        around = (slice(z, z + 3), slice(y, y + 3), slice(x, x + 3))
        assert (padded[around][own[around] == basins[z, y, x]] > distance[z, y, x]).any()


def grown(labels, heights):
    """A simple implementation: each voxel goes to its highest neighbour, local maxima along the highest pass."""
    inside = {tuple(place) for place in np.argwhere(labels != 0).tolist()}

    def rank(place):
        return heights[place], tuple(-k for k in place)

    def around(place):
        for axis, step in itertools.product(range(3), (-1, 1)):
            other = tuple(k + step * (i == axis) for i, k in enumerate(place))
            if other in inside:
                yield other

    up = {p: max([p, *around(p)], key=rank) for p in inside if labels[p] < 0}
    region = {}
    for place in inside:
        end = place
        while labels[end] < 0 and up[end] != end:
            end = up[end]
        region[place] = int(labels[end]) if labels[end] > 0 else end
    passes = [(heights[p], heights[q], p, q) for p in inside for q in around(p) if rank(q) > rank(p)]
    for _, _, p, q in sorted(passes, reverse=True):
        one, other = region[p], region[q]
        if one != other and not (isinstance(one, int) and isinstance(other, int)):
            keep, join = (one, other) if isinstance(one, int) else (other, one)
            region = {place: keep if r == join else r for place, r in region.items()}
    out = np.zeros(labels.shape, int)
    for place, r in region.items():
        out[place] = r if isinstance(r, int) else 0
    return out


def test_labels_grow_to_the_highest_first():
    noise, mask = rough(1, 0.8)
    noise, mask = (np.ascontiguousarray(a[:12, :16, :14]) for a in (noise, mask))
    seeds, count = ndimage.label(ndimage.binary_erosion(mask, iterations=2))
    labels = np.where(seeds > 0, seeds, np.where(mask, -1, 0)).astype(np.int32)
    expected = grown(labels, noise)
    grow_labels(labels, noise, count, Work())
    np.testing.assert_array_equal(labels, expected)


def test_labels_grow_as_in_a_watershed():
    noise, mask = rough(1, 0.8)
    seeds, count = ndimage.label(ndimage.binary_erosion(mask, iterations=2))
    labels = np.where(seeds > 0, seeds, np.where(mask, -1, 0)).astype(np.int32)
    grow_labels(labels, noise, count, Work())
    assert (labels == watershed(-noise, seeds, mask=mask)).mean() > 0.999


def test_pairs_of_labels():
    rng = np.random.default_rng(2)
    labels = np.kron(rng.integers(0, 4, (6, 8, 8)), np.ones((4, 4, 4), int))[:23, :31, :29].astype(np.int32)
    values, marks = rng.normal(size=SHAPE).astype(np.float32), rng.integers(-9, 9, SHAPE).astype(np.int32)
    found = LabelPairs.of(labels, values, 3, Work(), lambda block: block.gather(marks, 1, 0, np.int32))
    np.testing.assert_array_equal(found.pairs, [[1, 2], [1, 3], [2, 3]])
    padded = np.pad(labels, 1, "edge")
    expected = np.zeros(4, int)
    for axis in range(3):
        for step in (-1, 1):
            expected += np.bincount(labels[np.roll(padded, step, axis)[1:-1, 1:-1, 1:-1] != labels], minlength=4)
    np.testing.assert_array_equal(found.surface[1:], expected[1:])
    np.testing.assert_array_equal(found.label_marks[1:], [marks[labels == k].sum() for k in (1, 2, 3)])
    low, high, total = [], np.zeros(3, int), 0
    for axis in range(3):
        a, b = (np.moveaxis(labels, axis, 0)[part] for part in (slice(-1), slice(1, None)))
        meet = (np.minimum(a, b) == 1) & (np.maximum(a, b) == 3)
        high[axis] = meet.sum()
        for field, into in ((values, low), (marks, None)):
            one, other = (np.moveaxis(field, axis, 0)[part][meet] for part in (slice(-1), slice(1, None)))
            if into is None:
                total += (one + other).sum()
            else:
                into.extend(np.minimum(one, other))
    np.testing.assert_array_equal(found.faces[1], high)
    np.testing.assert_array_equal(found.tops[1], np.sort(low)[::-1][:4])
    assert found.marks[1] == total
    joined = found.renumbered(np.array([0, 1, 2, 1]))
    again = LabelPairs.of(np.array([0, 1, 2, 1], np.int32)[labels], values, 2, Work())
    for name in ("pairs", "faces", "tops", "beside"):
        np.testing.assert_array_equal(getattr(joined, name), getattr(again, name))
    np.testing.assert_array_equal(joined.surface[1:], again.surface[1:])
