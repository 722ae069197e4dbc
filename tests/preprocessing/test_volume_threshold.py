"""Otsu's threshold of a whole volume."""

import numpy as np
import pytest
from skimage.filters import threshold_otsu

from grainmotion.preprocessing import volume_threshold
from grainmotion.preprocessing.volume_threshold import otsu


def test_it_is_that_of_scikit_image():
    rng = np.random.default_rng(0)
    for _ in range(5):
        array = np.concatenate([rng.normal(0, 0.1, 500), rng.normal(1, 0.2, 300)]).astype(np.float32)
        assert otsu(array.reshape(8, 10, 10)) == threshold_otsu(array)


def test_parts_do_not_matter(monkeypatch):
    """Values are counted part by part, with progress in between."""
    rng = np.random.default_rng(3)
    array = np.concatenate([rng.normal(0, 0.01, 5000), rng.normal(0.05, 0.01, 3001)]).astype(np.float32)
    whole = otsu(array)
    monkeypatch.setattr(volume_threshold, "VALUES_COUNTED_TOGETHER", 700)
    assert otsu(array) == whole == pytest.approx(threshold_otsu(array), abs=1e-6)
