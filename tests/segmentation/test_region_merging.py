"""Merging of watershed basins (`segmentation.region_merging`): by depth, then by the neck between them."""

import dataclasses

import numpy as np
import pytest

from grainmotion.segmentation.region_merging import BasinGraph, Deficits


def graph(peaks, pairs, saddles, faces):
    """Basins 1 … n whose necks have the given numbers of faces along x."""
    areas = np.column_stack([np.zeros((len(faces), 2)), faces])
    return BasinGraph(np.array([0.0, *peaks]), np.array(pairs), np.array(saddles, float), areas)


def test_graph_of_two_touching_basins():
    distance = np.zeros((3, 3, 6), np.float32)
    distance[1, 1] = [0, 1, 3, 2, 4, 1]
    basins = np.zeros(distance.shape, np.int32)
    basins[1, 1, :3], basins[1, 1, 3:] = 1, 2
    basin_graph = BasinGraph.of(distance, basins)
    np.testing.assert_array_equal(basin_graph.peaks, [0, 3, 4])
    np.testing.assert_array_equal(basin_graph.pairs, [[1, 2]])
    np.testing.assert_array_equal(basin_graph.saddles, [2])
    np.testing.assert_array_equal(basin_graph.faces, [[0, 0, 1]])


@pytest.mark.parametrize(("depth", "labels"), [(0.5, [0, 1, 2]), (1.5, [0, 1, 1])])
def test_a_shallow_basin_is_merged(depth, labels):
    basin_graph = graph([5.0, 4.0], [[1, 2]], [3.0], [1])
    np.testing.assert_array_equal(basin_graph.merged(depth, 0.7), labels)


def test_basins_with_a_high_saddle_are_merged():
    basin_graph = graph([10.0, 10.0], [[1, 2]], [9.1], [1])
    np.testing.assert_array_equal(basin_graph.merged(0.5, 0.7), [0, 1, 1])


@pytest.mark.parametrize(("faces", "labels"), [(60, [0, 1, 1]), (20, [0, 1, 2])])
def test_basins_with_a_stiff_neck_are_merged(faces, labels):
    """κ = s² A / (π m⁴) with s = 3, m = 4: 0.67 for 60 faces, 0.22 for 20."""
    basin_graph = graph([5.0, 4.0], [[1, 2]], [3.0], [faces])
    np.testing.assert_array_equal(basin_graph.merged(0.5, 0.5), labels)


def test_basins_in_a_row_are_merged_in_the_order_of_their_necks():
    basin_graph = graph([4.0, 4.0, 4.0, 4.0], [[1, 2], [2, 3], [3, 4]], [3.0, 3.0, 1.0], [90, 80, 1])
    np.testing.assert_array_equal(basin_graph.merged(0.0, 0.5), [0, 1, 1, 1, 2])


def with_deficits(basin_graph, basins, necks, noise=0.0):
    """The graph with mean deficits of its basins, of ten voxels each, and of its necks."""
    voxels = np.full(len(basin_graph.peaks), 10.0)
    sums = np.array(necks) * basin_graph.faces.sum(axis=1)
    return dataclasses.replace(basin_graph, deficits=Deficits(voxels * [0, *basins], voxels, sums, noise))


@pytest.mark.parametrize("saddle", [3.5, 3.9])
@pytest.mark.parametrize(("neck", "labels"), [(0.01, [0, 1, 1]), (0.05, [0, 1, 2])])
def test_basins_with_a_valley_between_them_are_two(saddle, neck, labels):
    """Of a neck that is wide enough, and of a saddle that is high enough."""
    basin_graph = with_deficits(graph([5.0, 4.0], [[1, 2]], [saddle], [60]), [0.0, 0.0], [neck])
    np.testing.assert_array_equal(basin_graph.merged(0.2, 0.7), labels)


@pytest.mark.parametrize(("basins", "noise"), [([0.05, 0.06], 0.0), ([0.0, 0.0], 0.4)])
def test_a_neck_as_faint_as_its_basins_or_as_noise_makes_it_is_no_valley(basins, noise):
    basin_graph = with_deficits(graph([5.0, 4.0], [[1, 2]], [3.5], [60]), basins, [0.05], noise)
    np.testing.assert_array_equal(basin_graph.merged(0.2, 0.7), [0, 1, 1])


def test_deficits_of_basins_and_necks_follow_merging():
    """Basins 1 and 2 are one; both together have a valley towards 3, though 2 alone has none."""
    basin_graph = graph([4.0, 4.0, 4.0], [[1, 2], [1, 3], [2, 3]], [3.9, 3.5, 3.5], [60, 60, 20])
    basin_graph = with_deficits(basin_graph, [0.0, 0.0, 0.0], [0.0, 0.06, 0.0])
    np.testing.assert_array_equal(basin_graph.merged(0.2, 0.6), [0, 1, 1, 2])


def test_a_graph_without_basins():
    empty = BasinGraph(np.zeros(1), np.zeros((0, 2), int), np.zeros(0), np.zeros((0, 3)))
    np.testing.assert_array_equal(empty.merged(0.5, 0.7), [0])


def merged_one_by_one(basin_graph, oneness):
    """The same without a queue: of all pairs the one with the stiffest neck, until none is stiff enough."""
    peaks, of = basin_graph.peaks.copy(), np.arange(len(basin_graph.peaks))
    necks = {tuple(pair): (s, f) for pair, s, f in zip(basin_graph.pairs, basin_graph.saddles, basin_graph.faces)}
    while necks:
        kappas = {
            (a, b): s**2 * np.linalg.norm(f) / (np.pi * min(peaks[a], peaks[b]) ** 4)
            for (a, b), (s, f) in necks.items()
        }
        a, b = min(kappas, key=lambda pair: (-kappas[pair], pair))
        if kappas[a, b] < oneness:
            break
        peaks[a] = max(peaks[a], peaks[b])
        of[of == b] = a
        gathered = {}
        for pair, (s, f) in necks.items():
            pair = tuple(sorted(a if k == b else k for k in pair))
            if pair != (a, a):
                known = gathered.get(pair, (0.0, np.zeros(3)))
                gathered[pair] = max(s, known[0]), f + known[1]
        necks = gathered
    return np.unique(of, return_inverse=True)[1]


@pytest.mark.parametrize("seed", range(5))
def test_many_basins_are_merged_as_one_by_one(seed):
    rng, count = np.random.default_rng(seed), 40
    pairs = np.unique(np.sort(rng.integers(1, count + 1, (150, 2)), axis=1), axis=0)
    pairs = pairs[pairs[:, 0] < pairs[:, 1]]
    peaks = np.round(np.concatenate([[0], rng.uniform(3, 6, count)]), 1)
    saddles = peaks[pairs].min(axis=1) * rng.uniform(0.3, 0.85, len(pairs))
    faces = rng.integers(1, 30, (len(pairs), 3)).astype(float)
    basin_graph = BasinGraph(peaks, pairs, saddles, faces)
    found = basin_graph.merged(0.0, 0.6)
    assert 1 < found.max() < count
    np.testing.assert_array_equal(found, merged_one_by_one(basin_graph, 0.6))
