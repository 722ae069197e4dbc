"""Centroids and boxes of labels, on shapes whose points are known."""

import numpy as np
import pytest

from grainmotion.errors import InputError
from grainmotion.model.volume import Volume
from grainmotion.segmentation.label_points import LabelPoints

GRID = Volume.zeros((10, 12, 14), 0.5, (1.0, 2.0, 3.0))


def test_points_of_an_l_shape_and_of_one_voxel():
    image = np.zeros(GRID.shape, np.uint16)
    image[2, 3, 4:10] = 5  # six voxels along x
    image[3:5, 3, 4] = 5  # and two along z
    image[9, 11, 13] = 7
    points = LabelPoints.of(image, GRID)
    assert points.labels.tolist() == [5, 7]
    centroid = np.array([(4 + 5 + 6 + 7 + 8 + 9 + 4 + 4) / 8, 3, (6 * 2 + 3 + 4) / 8])  # x y z, voxels
    np.testing.assert_allclose(points.centroids[0], GRID.origin + 0.5 * centroid)
    np.testing.assert_allclose(points.box_centers[0], GRID.origin + 0.5 * np.array([6.5, 3, 3]))
    np.testing.assert_allclose(points.centroids[1], GRID.origin + 0.5 * np.array([13, 11, 9]))
    np.testing.assert_allclose(points.box_centers[1], points.centroids[1])
    assert points.rows_of([7, 6, 5]).tolist() == [1, -1, 0]


def test_no_labels_have_no_points():
    points = LabelPoints.of(np.zeros(GRID.shape, np.int32), GRID)
    assert len(points.labels) == 0
    assert points.centroids.shape == points.box_centers.shape == (0, 3)


def test_labels_of_another_shape_are_refused():
    with pytest.raises(InputError, match=r"shape \(2, 2, 2\) is not the volume's"):
        LabelPoints.of(np.zeros((2, 2, 2), int), GRID)
