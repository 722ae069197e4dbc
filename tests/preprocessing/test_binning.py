"""Binning (`preprocessing.binning`) of scans, images and grids: values, positions, masks."""

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


ALL_VIEWS = np.arange(3)


class TestScan:
    def test_pixels_are_means_and_centred_on_the_panel(self):
        binned = binned_scan(scan(), 3, ALL_VIEWS)
        assert binned.geometry.shape == (2, 4)
        np.testing.assert_allclose(binned.line_integrals[1, 1, 2], scan().line_integrals[1, 3:6, 6:9].mean(), rtol=1e-6)

    @pytest.mark.parametrize("factor", [2, 3])
    def test_a_binned_pixel_is_at_the_mean_position_of_its_pixels(self, factor):
        binned, whole = binned_scan(scan(), factor, ALL_VIEWS), scan().geometry
        cut = tuple(slice((n - n // factor * factor) // 2, None) for n in PANEL)
        expected = whole.pixel_positions(1)[cut][:factor, :factor].mean(axis=(0, 1))
        np.testing.assert_allclose(binned.geometry.pixel_positions(1)[0, 0], expected, atol=1e-12)

    def test_masked_pixels_carry_no_weight(self):
        valid = np.ones((3, *PANEL), bool)
        valid[0, :2, 0] = False
        valid[1, 2:4, 2:4] = False
        binned = binned_scan(scan(valid), 2, ALL_VIEWS)
        assert binned.valid is not None
        np.testing.assert_array_equal(np.argwhere(~binned.valid), [[1, 1, 1]])
        np.testing.assert_allclose(binned.line_integrals[0, 0, 0], scan().line_integrals[0, :2, 1].mean(), rtol=1e-6)

    def test_a_range_of_rows_equals_those_of_the_whole(self):
        rows = binned_scan(scan(), 2, ALL_VIEWS, (1, 3))
        whole = binned_scan(scan(), 2, ALL_VIEWS)
        np.testing.assert_array_equal(rows.line_integrals, whole.line_integrals[:, 1:3])
        np.testing.assert_allclose(rows.geometry.pixel_positions(2), whole.geometry.pixel_positions(2)[1:3], atol=1e-12)


def test_images_keep_their_mean_and_precision():
    images = np.random.default_rng(1).random((2, 6, 8)).astype(np.float32)
    binned = binned_images(images, 2)
    assert binned.dtype == np.float32
    np.testing.assert_allclose(binned.mean(axis=(1, 2)), images.mean(axis=(1, 2)), rtol=1e-6)


def test_a_binned_grid_covers_the_grid_and_keeps_its_centre():
    grid = binned_grid(Volume.zeros((5, 8, 9), 0.1, (1.0, 2.0, 3.0)), 2)
    assert (grid.shape, grid.center) == ((3, 4, 5), (1.0, 2.0, 3.0))
    assert grid.voxel_size == pytest.approx(0.2)


def test_about_two_views_for_each_column_are_kept():
    np.testing.assert_array_equal(sufficient_views(90, 10), np.arange(0, 90, 4))
    np.testing.assert_array_equal(sufficient_views(5, 10), np.arange(5))


@pytest.mark.parametrize(("panel", "factor"), [((100, 100), 5), ((6, 100), 3), ((1, 100), 1), ((9, 7), 1)])
def test_the_factor_is_limited_by_the_smaller_side_of_the_panel(panel, factor):
    assert binning_factor(panel, 20) == factor
