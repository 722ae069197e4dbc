"""Levels of attenuation from the insides of bodies (`segmentation.uniform_cores`)."""

import numpy as np
from scipy import ndimage

from grainmotion.segmentation.blocks import Work
from grainmotion.segmentation.border import BeyondField
from grainmotion.segmentation.uniform_cores import UniformCores

SHAPE = (40, 40, 60)


def volume():
    """Two grains of 1, one of them beyond the field, and smeared attenuation of 0.2 beyond it, too."""
    array = np.zeros(SHAPE)
    array[8:20, 8:20, 8:20] = array[8:20, 8:20, 44:56] = 1.0
    array[26:36, 26:36, 44:56] = 0.2
    aside = np.zeros(SHAPE[1:], bool)
    aside[:, 40:] = True
    beyond = BeyondField(np.zeros(SHAPE[0]), np.full(aside.shape, -1.0), np.full(aside.shape, 1.0), aside)
    return ndimage.gaussian_filter(array, 0.7).astype(np.float32), beyond


def test_smeared_attenuation_beyond_the_field_is_no_level():
    array, beyond = volume()
    assert len(UniformCores.of(array, 0.5).levels) == 3
    cores = UniformCores.of(array, 0.5, beyond=beyond)
    np.testing.assert_allclose(cores.levels, [0, 1], atol=0.02)
    assert cores.labels(Work())[31, 31, 50] == 0


def test_grains_beyond_the_field_keep_their_cores():
    array, beyond = volume()
    cores = UniformCores.of(array, 0.5, beyond=beyond)
    labels = cores.labels(Work())
    assert cores.level_of[labels[14, 14, 50]] == cores.level_of[labels[14, 14, 14]] == 1
