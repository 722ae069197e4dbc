"""What `inspect` tells of a volume or of labels in a file of images."""

from __future__ import annotations

import numpy as np
import pytest
import tifffile

from grainmotion.errors import InputError
from grainmotion.experiment.file_contents import describe_file

LABELS = np.zeros((12, 11, 10), np.uint8)
LABELS[4:9, 2:6, 2:6] = 3


def told(path):
    """Texts by their labels."""
    return dict(describe_file(path))


def test_an_array_with_a_channel_is_a_volume(tmp_path):
    np.save(tmp_path / "a.npy", LABELS[None])
    lines = told(tmp_path / "a.npy")
    assert lines["Volume"].startswith("12 x 11 x 10 voxels (z, y, x) uint8")
    assert lines["Values"] == "0 to 3 in the middle slice, 2 different"
    assert lines["Use"] == 'volume = "a.npy" or labels = "a.npy" in [reference]'


def test_numbers_of_a_colour_map_are_labels(tmp_path):
    colours = np.random.default_rng(0).integers(0, 65535, (3, 256)).astype(np.uint16)
    tifffile.imwrite(tmp_path / "a.tif", LABELS, photometric="palette", colormap=colours)
    assert told(tmp_path / "a.tif")["Use"] == 'labels = "a.tif" in [reference]'


def test_colours_are_refused(tmp_path):
    tifffile.imwrite(tmp_path / "a.tif", np.stack([LABELS, LABELS, 2 * LABELS], axis=-1), photometric="rgb")
    with pytest.raises(InputError, match="its red, green and blue differ"):
        describe_file(tmp_path / "a.tif")


@pytest.mark.parametrize(("share", "text"), [(1.0, "NaN in 5"), (0.5, "1 to 1, 50% NaN, in 5")])
@pytest.mark.filterwarnings("error")
def test_missing_values_are_counted(tmp_path, share, text):
    array = np.ones((12, 10, 10))
    array[:, : int(10 * share)] = np.nan
    np.save(tmp_path / "a.npy", array)
    assert told(tmp_path / "a.npy")["Values"].startswith(text)
