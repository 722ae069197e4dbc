"""Larger pixels and voxels show the same sample in the same place."""

import numpy as np
import pytest

from grainmotion.model.geometry import Geometry
from grainmotion.model.scan import Scan
from grainmotion.model.volume import Volume
from grainmotion.preprocessing.binning import (
    binned_grid,
    binned_images,
    binned_scan,
    binning_factor,
    sufficient_views,
)

PANEL = (7, 13)


def scan(valid=None):
    images = np.random.default_rng(0).random((3, *PANEL)).astype(np.float32)
    return Scan(images, Geometry.parallel([0.0, 50.0, 90.0], PANEL, 0.1), valid)


ALL = np.arange(3)


class TestScan:
    def test_pixels_are_means_around_the_panel_s_middle(self):
        binned = binned_scan(scan(), 3, ALL)
        assert binned.geometry.shape == (2, 4)
        np.testing.assert_allclose(binned.line_integrals[1, 1, 2], scan().line_integrals[1, 3:6, 6:9].mean(), rtol=1e-6)

    @pytest.mark.parametrize("factor", [2, 3])
    def test_a_pixel_lies_in_the_middle_of_those_it_holds(self, factor):
        binned, whole = binned_scan(scan(), factor, ALL), scan().geometry
        cut = tuple(slice((n - n // factor * factor) // 2, None) for n in PANEL)
        inside = whole.pixel_positions(1)[cut][:factor, :factor].mean(axis=(0, 1))
        np.testing.assert_allclose(binned.geometry.pixel_positions(1)[0, 0], inside, atol=1e-12)

    def test_masked_pixels_carry_no_weight(self):
        valid = np.ones((3, *PANEL), bool)
        valid[0, :2, 0] = False
        valid[1, 2:4, 2:4] = False
        binned = binned_scan(scan(valid), 2, ALL)
        assert binned.valid is not None
        np.testing.assert_array_equal(np.argwhere(~binned.valid), [[1, 1, 1]])
        np.testing.assert_allclose(binned.line_integrals[0, 0, 0], scan().line_integrals[0, :2, 1].mean(), rtol=1e-6)

    def test_some_rows_are_those_of_the_whole(self):
        rows = binned_scan(scan(), 2, ALL, (1, 3))
        whole = binned_scan(scan(), 2, ALL)
        np.testing.assert_array_equal(rows.line_integrals, whole.line_integrals[:, 1:3])
        np.testing.assert_allclose(rows.geometry.pixel_positions(2), whole.geometry.pixel_positions(2)[1:3], atol=1e-12)


def test_images_keep_their_mean_and_precision():
    images = np.random.default_rng(1).random((2, 6, 8)).astype(np.float32)
    binned = binned_images(images, 2)
    assert binned.dtype == np.float32
    np.testing.assert_allclose(binned.mean(axis=(1, 2)), images.mean(axis=(1, 2)), rtol=1e-6)


def test_a_grid_is_covered_around_its_centre():
    grid = binned_grid(Volume.zeros((5, 8, 9), 0.1, (1.0, 2.0, 3.0)), 2)
    assert (grid.shape, grid.center) == ((3, 4, 5), (1.0, 2.0, 3.0))
    assert grid.voxel_size == pytest.approx(0.2)


def test_two_views_a_column():
    np.testing.assert_array_equal(sufficient_views(90, 10), np.arange(0, 90, 4))
    np.testing.assert_array_equal(sufficient_views(5, 10), np.arange(5))


@pytest.mark.parametrize(("panel", "factor"), [((100, 100), 5), ((6, 100), 3), ((1, 100), 1), ((9, 7), 1)])
def test_a_panel_of_few_rows_is_not_binned_away(panel, factor):
    assert binning_factor(panel, 20) == factor
