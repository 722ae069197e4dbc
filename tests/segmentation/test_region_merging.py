"""Merging of watershed basins (`segmentation.region_merging`): by depth, then by the neck between them."""

import numpy as np
import pytest

from grainmotion.segmentation.region_merging import BasinGraph


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


def test_a_graph_without_basins():
    empty = BasinGraph(np.zeros(1), np.zeros((0, 2), int), np.zeros(0), np.zeros((0, 3)))
    np.testing.assert_array_equal(empty.merged(0.5, 0.7), [0])
