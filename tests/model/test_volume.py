"""Volume (`model.volume`): position of its voxels, precision, refused input."""

import numpy as np
import pytest

from grainmotion.errors import InputError
from grainmotion.model.volume import Volume


class TestPosition:
    def test_origin_is_the_centre_of_the_first_voxel(self):
        volume = Volume.zeros((2, 3, 4), 0.5, (10.0, 20.0, 30.0))
        np.testing.assert_allclose(volume.origin, [10 - 0.75, 20 - 0.5, 30 - 0.25])

    @pytest.mark.parametrize("shape", [(1, 1, 1), (4, 5, 6), (7, 2, 3)])
    def test_first_and_last_voxel_are_symmetric_about_the_centre(self, shape):
        volume = Volume.zeros(shape, 0.3, (1.0, -2.0, 3.0))
        last = volume.origin + 0.3 * (np.array(shape[::-1]) - 1)
        np.testing.assert_allclose((volume.origin + last) / 2, volume.center)

    def test_a_single_voxel_is_at_the_centre(self):
        np.testing.assert_array_equal(Volume.zeros((1, 1, 1), 0.5, (1, 2, 3)).origin, [1, 2, 3])


class TestArray:
    def test_integers_become_contiguous_single_precision(self):
        given = np.arange(24, dtype=np.int16).reshape(4, 3, 2).T
        volume = Volume(given, 1)
        assert volume.array.dtype == np.float32
        assert volume.array.flags.c_contiguous
        assert volume.shape == (2, 3, 4)
        np.testing.assert_array_equal(volume.array, given)
        assert isinstance(volume.voxel_size, float)

    def test_repr(self):
        assert repr(Volume.zeros((2, 3, 4), 0.5)) == "<Volume: 2 × 3 × 4 voxels (z, y, x) of 0.5 mm>"


@pytest.mark.parametrize(
    ("given", "kept"), [(np.float64, np.float64), (np.float32, np.float32), (np.int16, np.float32), (bool, np.float32)]
)
def test_double_precision_is_kept_and_anything_else_becomes_single(given, kept):
    assert Volume(np.ones((2, 3, 4), given), 1.0).array.dtype == kept


class TestRefused:
    @pytest.mark.parametrize("shape", [(3, 4), (2, 3, 4, 5), (0, 3, 4), (5,)])
    def test_arrays_that_are_not_3d(self, shape):
        with pytest.raises(InputError, match=r"is not \(z, y, x\); give a 3-D stack"):
            Volume(np.zeros(shape), 1.0)

    @pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
    def test_nan_or_infinite_voxels(self, value):
        array = np.zeros((2, 2, 2))
        array[1, 0, 1] = value
        with pytest.raises(InputError, match="NaN or infinite voxels"):
            Volume(array, 1.0)

    def test_voxels_beyond_single_precision(self):
        with pytest.raises(InputError, match="NaN or infinite voxels"):
            Volume(np.full((2, 2, 2), 10**39, dtype=object), 1.0)

    @pytest.mark.parametrize("size", [0, -1.0, np.nan, np.inf])
    def test_voxel_sizes_that_are_not_positive(self, size):
        with pytest.raises(InputError, match=r"volume\.voxel_size: must be > 0, got"):
            Volume(np.zeros((2, 2, 2)), size)

    @pytest.mark.parametrize("center", [(0, 0, np.nan), (np.inf, 0, 0), (0, 0), (0, 0, 0, 0)])
    def test_centers_that_are_not_three_finite_numbers(self, center):
        with pytest.raises(InputError, match=r"volume\.center: .* 3 finite numbers"):
            Volume(np.zeros((2, 2, 2)), 1.0, center)


def test_xarray_has_the_places_of_the_voxels():
    volume = Volume(np.arange(24.0).reshape(2, 3, 4), 0.5, (1.0, 2.0, 3.0))
    array = volume.to_xarray()
    assert array.dims == ("z", "y", "x")
    np.testing.assert_allclose([array[axis][0] for axis in "xyz"], volume.origin)
    assert float(array.sel(z=3.25, y=2.0, x=0.25, method="nearest")) == volume.array[1, 1, 0]
    assert array.attrs["units"] == "1/mm"
    assert array["x"].attrs["units"] == "mm"
