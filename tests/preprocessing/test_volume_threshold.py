"""Otsu's threshold of a whole volume."""

import numpy as np
from skimage.filters import threshold_otsu

from grainmotion.preprocessing.volume_threshold import otsu


def test_it_is_that_of_scikit_image():
    rng = np.random.default_rng(0)
    for _ in range(5):
        array = np.concatenate([rng.normal(0, 0.1, 500), rng.normal(1, 0.2, 300)]).astype(np.float32)
        assert otsu(array.reshape(8, 10, 10)) == threshold_otsu(array)
