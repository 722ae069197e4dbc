"""Grains that are all flat or all upright are told, as pixels that are not square make them."""

from __future__ import annotations

import numpy as np
import pytest

from grainmotion.diagnosis.grain_shapes import check_grain_shapes, heights_over_widths


def ellipsoids(height: float, count: int = 6) -> np.ndarray:
    """Labels of ellipsoids with a radius of 5 voxels across."""
    z, y, x = np.indices((40, 16, 16 * count))
    labels = np.zeros(z.shape, np.int32)
    for k in range(count):
        inside = ((z - 20) / (5 * height)) ** 2 + ((y - 8) / 5) ** 2 + ((x - 16 * k - 8) / 5) ** 2 < 1
        labels[inside] = k + 1
    return labels


@pytest.mark.parametrize("height", [0.5, 1.0, 2.0])
def test_height_over_width_is_that_of_the_ellipsoids(height: float):
    assert heights_over_widths(ellipsoids(height)) == pytest.approx(height, rel=0.05)


@pytest.mark.parametrize(("height", "count", "told"), [(1, 6, 0), (0.7, 6, 0), (0.5, 6, 1), (2, 6, 1), (0.5, 3, 0)])
def test_flat_and_upright_grains_are_told_if_there_are_enough(height: float, count: int, told: int):
    assert len(check_grain_shapes(ellipsoids(height, count))) == told


def test_labels_without_grains_give_no_finding():
    assert check_grain_shapes(np.zeros((3, 3, 3), np.int32)) == ()


def test_platens_do_not_count():
    labels = np.pad(ellipsoids(0.7), ((3, 3), (0, 0), (0, 0)))
    labels[:3], labels[-3:] = 7, 8
    assert check_grain_shapes(labels) == ()
