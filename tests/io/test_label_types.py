"""Labels of other programs: numbers of any type, with gaps; what stands for no grain; what is refused, and why."""

from __future__ import annotations

import numpy as np
import pytest
import tifffile

import grainmotion as gm
from grainmotion.errors import InputError
from grainmotion.model.volume import Volume

LABELS = np.zeros((7, 6, 5), np.int64)
LABELS[1:3, 1:3, 1:3], LABELS[4:6, 3:5, 2:4] = 3, 70
INTEGERS = ["u1", "i1", "u2", "i2", "u4", "i4", "u8", "i8", ">u2", ">i4"]


@pytest.mark.parametrize("dtype", [*INTEGERS, "f2", "f4", "f8"])
@pytest.mark.parametrize("file", ["labels.npy", "labels.tif"])
def test_numbers_of_any_type_are_kept_with_their_gaps(tmp_path, dtype, file):
    array = LABELS.astype(dtype)
    np.save(tmp_path / file, array) if file.endswith("npy") else tifffile.imwrite(tmp_path / file, array)
    np.testing.assert_array_equal(gm.read_labels(tmp_path / file), LABELS)


def read(tmp_path, array):
    """Labels of an array in a file."""
    np.save(tmp_path / "labels.npy", array)
    return gm.read_labels(tmp_path / "labels.npy")


class TestNoGrain:
    @pytest.mark.parametrize("number", [-1, -32768])
    def test_one_negative_number_around_the_grains(self, tmp_path, number):
        array = np.where(LABELS == 0, number, LABELS).astype(np.int16)
        np.testing.assert_array_equal(read(tmp_path, array), LABELS)

    def test_lines_of_a_watershed(self, tmp_path):
        """-1 between the grains, 0 around them."""
        array = LABELS.copy()
        array[3, 2:4, 2] = -1
        np.testing.assert_array_equal(read(tmp_path, array), LABELS)

    def test_a_label_over_the_top_of_its_type(self, tmp_path):
        array = np.where(LABELS == 70, 40_000, LABELS).astype(np.uint16).view(np.int16)
        with pytest.raises(
            InputError, match=r"label -25536 beside 0 .* over the top of int16; export them as unsigned"
        ):
            read(tmp_path, array)
        array = np.where(LABELS == 3, 40_001, np.where(LABELS == 70, 40_000, 0)).astype(np.uint16).view(np.int16)
        with pytest.raises(InputError, match="from -25536 to -25535: probably they ran over the top of int16"):
            read(tmp_path, array)

    def test_grains_from_zero_on(self, tmp_path):
        """As clustering numbers them: -1 for no grain, 0 for the first."""
        array = np.where(LABELS == 70, 1, np.where(LABELS == 3, 0, -1))
        with pytest.raises(InputError, match=r"0 holds 8 voxels, as a grain does.* give labels \+ 1"):
            read(tmp_path, array)

    def test_nan_is_named(self, tmp_path):
        with pytest.raises(InputError, match="92% of its voxels are NaN, not whole numbers; give 0 for no grain"):
            read(tmp_path, np.where(LABELS == 0, np.nan, LABELS))


@pytest.mark.parametrize(
    ("array", "message"),
    [
        (np.where(LABELS == 3, np.uint64(2**32), 0), "a label of 4294967296; number the grains up to 10000000"),
        (np.where(LABELS == 3, np.uint64(2**63), 0), "a label of 9223372036854775808"),
        (np.where(LABELS == 3, 2.0**32, 0), "a label of 4294967296"),
        (np.where(LABELS == 3, 2.5, 0), "not whole numbers: grey values or a probability"),
        (np.where(LABELS == 3, np.inf, 0), "not whole numbers"),
        (LABELS.astype(complex), "complex128, no real numbers"),
        (0 * LABELS, "no grains found"),
    ],
)
def test_what_is_refused(tmp_path, array, message):
    with pytest.raises(InputError, match=message):
        read(tmp_path, array)


class TestColourMap:
    """Avizo's label fields and Fiji's images with a lookup table are TIFFs with a colour map."""

    @pytest.fixture
    def path(self, tmp_path):
        """Labels shown in random colours."""
        colours = np.random.default_rng(0).integers(0, 65535, (3, 256)).astype(np.uint16)
        tifffile.imwrite(tmp_path / "labels.tif", LABELS.astype(np.uint8), photometric="palette", colormap=colours)
        return tmp_path / "labels.tif"

    def test_labels_are_its_numbers(self, path):
        np.testing.assert_array_equal(gm.read_labels(path), LABELS)

    def test_attenuation_is_not(self, path):
        with pytest.raises(InputError, match="numbers of a colour map; save it as a grey image"):
            gm.read_volume(path, voxel_size=0.1)


def test_a_mask_has_one_label(tmp_path):
    np.testing.assert_array_equal(read(tmp_path, LABELS > 0), LABELS > 0)
    with pytest.raises(InputError, match="mask"):
        gm.grains_from_labels(Volume.zeros(LABELS.shape, 0.1), LABELS > 0)


def test_formats_that_are_unknown_are_told_those_of_volumes(tmp_path):
    (tmp_path / "labels.czi").write_bytes(bytes(100))
    with pytest.raises(InputError, match=r"'\.czi' is unknown; give a TIFF stack or series, .* OME-Zarr"):
        gm.read_labels(tmp_path / "labels.czi")
