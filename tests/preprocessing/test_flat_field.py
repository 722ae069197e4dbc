"""Line integrals from counts or transmission (`preprocessing.flat_field`): Beer–Lambert law and bad pixels."""

import numpy as np
import pytest

from grainmotion.errors import InputError
from grainmotion.model.geometry import Geometry
from grainmotion.preprocessing.flat_field import (
    checked_line_integrals,
    line_integrals_from_counts,
    line_integrals_from_transmission,
)

SHAPE = (7, 9)


def parallel(views, shape=SHAPE):
    return Geometry.parallel(np.arange(views) * 10.0, shape, 0.1)


def beer_lambert(line_integrals, flat=50_000.0, dark=100.0):
    return dark + (flat - dark) * np.exp(-line_integrals)


@pytest.fixture
def thickness():
    return np.random.default_rng(0).uniform(0, 2, (3, *SHAPE))


class TestCounts:
    def test_beer_lambert_is_undone(self, thickness):
        scan, report = line_integrals_from_counts(
            beer_lambert(thickness), np.full(SHAPE, 50_000.0), np.full(SHAPE, 100.0), parallel(3)
        )
        np.testing.assert_allclose(scan.line_integrals, thickness, atol=1e-5)
        assert scan.valid is None
        assert report.bad == 0
        assert report.total == thickness.size

    def test_flats_and_darks_are_averaged(self, thickness):
        flats = 50_000.0 + np.array([-30.0, 10.0, 20.0])[:, None, None] + np.zeros(SHAPE)
        darks = 100.0 + np.array([-5.0, 5.0])[:, None, None] + np.zeros(SHAPE)
        scan, _ = line_integrals_from_counts(beer_lambert(thickness), flats, darks, parallel(3))
        np.testing.assert_allclose(scan.line_integrals, thickness, atol=1e-5)

    def test_without_darks_the_dark_level_is_zero(self, thickness):
        counts = beer_lambert(thickness, dark=0.0)
        scan, _ = line_integrals_from_counts(counts, np.full(SHAPE, 50_000.0), None, parallel(3))
        np.testing.assert_allclose(scan.line_integrals, thickness, atol=1e-5)

    def test_dead_dark_and_saturated_pixels_are_counted_masked_and_repaired(self):
        counts = beer_lambert(np.ones((3, *SHAPE))).astype(np.uint16)
        flats = np.full(SHAPE, 50_000, np.uint16)
        flats[2, 3] = 0  # dead in all views
        counts[1, 5, 5] = 100  # no photon was transmitted
        counts[2, 0, 0] = 65_535  # largest value of the type
        scan, report = line_integrals_from_counts(counts, flats, np.full(SHAPE, 100, np.uint16), parallel(3))
        assert (report.dead, report.dark, report.saturated) == (3, 1, 1)
        assert report.bad == 5
        assert "3 dead, 1 dark, 1 saturated" in str(report)
        assert scan.valid is not None
        assert (~scan.valid).sum() == 5
        assert not scan.valid[:, 2, 3].any()
        np.testing.assert_allclose(scan.line_integrals, 1.0, atol=1e-3)

    def test_saturation_level_can_be_set(self):
        counts = np.full((1, *SHAPE), 2000, np.uint16)
        counts[0, 3, 3] = 4095
        flats = np.full(SHAPE, 4000, np.uint16)
        assert line_integrals_from_counts(counts, flats, None, parallel(1))[1].saturated == 0
        _, report = line_integrals_from_counts(counts, flats, None, parallel(1), saturation=4095)
        assert report.saturated == 1

    def test_saturated_flat_masks_the_pixel_in_all_views(self):
        counts, flats = np.full((2, *SHAPE), 2000, np.uint16), np.full((3, *SHAPE), 4000, np.uint16)
        flats[1, 4, 4] = 65_535
        scan, report = line_integrals_from_counts(counts, flats, None, parallel(2))
        assert report.saturated == 2
        assert scan.valid is not None
        assert not scan.valid[:, 4, 4].any()

    def test_a_large_hole_is_filled_from_the_nearest_good_pixels(self):
        counts = beer_lambert(np.ones((1, 20, 20)))
        counts[0, 4:12, 4:12] = 0.0
        flats, darks = np.full((20, 20), 50_000.0), np.full((20, 20), 100.0)
        scan, report = line_integrals_from_counts(counts, flats, darks, parallel(1, (20, 20)))
        assert report.dark == 64
        np.testing.assert_allclose(scan.line_integrals, 1.0, atol=1e-3)

    @pytest.mark.parametrize(
        ("change", "where", "fact"),
        [
            (lambda c, f, d: (np.where(c > np.median(c), np.nan, c), f, d), "counts", "NaN"),
            (lambda c, f, d: (-c, f, d), "counts", "negative"),
            (lambda c, f, d: (c, d, f), "flats", "at or below the mean dark"),
            (lambda c, f, d: (c, -f, d), "flats", "negative"),
            (lambda c, f, d: (c, f, d * np.nan), "darks", "NaN"),
            (lambda c, f, d: (c, f[:-1], d), "flats", "pixels"),
            (lambda c, f, d: (c[:2], f, d), "counts", "2 radiographs"),
            (lambda c, f, d: (c[:, 1:], f, d), "counts", "pixels"),
            (lambda c, f, d: (c * 0, f, d), "counts", "view 0 has no pixel"),
        ],
    )
    def test_invalid_counts_flats_or_darks_are_refused(self, thickness, change, where, fact):
        given = change(beer_lambert(thickness), np.full(SHAPE, 50_000.0), np.full(SHAPE, 100.0))
        with pytest.raises(InputError, match=fact) as raised:
            line_integrals_from_counts(*given, parallel(3))
        assert raised.value.where == where


class TestTransmissionAndLineIntegrals:
    def test_line_integrals_from_transmission(self, thickness):
        transmission = np.exp(-thickness)
        transmission[0, 0, 0] = -0.01
        scan, report = line_integrals_from_transmission(transmission, parallel(3))
        assert report.dark == 1
        assert scan.valid is not None
        np.testing.assert_allclose(scan.line_integrals[scan.valid], thickness[scan.valid], atol=1e-5)
        assert np.isfinite(scan.line_integrals).all()

    def test_line_integrals_are_unchanged(self, thickness):
        scan, report = checked_line_integrals(thickness, parallel(3))
        np.testing.assert_array_equal(scan.line_integrals, thickness.astype(np.float32))
        assert report.bad == 0

    @pytest.mark.parametrize("convert", [line_integrals_from_transmission, checked_line_integrals])
    def test_nan_and_counts_are_refused(self, thickness, convert):
        broken = thickness.copy()
        broken[1, 2:4, 3:] = np.nan
        with pytest.raises(InputError, match=r"19 % of view 1 is NaN or infinite, from row 2, column 3 on"):
            convert(broken, parallel(3))
        with pytest.raises(InputError, match='set kind = "counts"'):
            convert(beer_lambert(thickness), parallel(3))
