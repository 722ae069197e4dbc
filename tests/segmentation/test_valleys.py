"""Voxels fainter than others as deep (`segmentation.valleys`)."""

import numpy as np
import pytest
from scipy import ndimage

from grainmotion.segmentation.blocks import Work, blocks_of
from grainmotion.segmentation.valleys import MAX_LEVEL, NOISE_BINS, Valleys


def deficits(level, distance):
    """Deficits of all voxels, and their noise."""
    level = level.astype(np.float32)
    valleys = Valleys.of(lambda block, reach: block.gather(level, reach, 0), distance, Work())
    faint, counts = np.zeros(distance.shape), np.zeros(NOISE_BINS, np.int64)
    for block in blocks_of(distance.shape):
        own = valleys.deficits(block)
        faint[block.box] = own[1:-1, 1:-1, 1:-1]
        counts += valleys.noise_counts(block, own)
    return faint, valleys.noise_of(counts)


def test_a_voxel_is_compared_with_those_as_deep():
    distance = np.zeros((3, 3, 40), np.float32)
    distance[1, 1, ::2], distance[1, 1, 1::2] = 1.0, 3.0
    level = np.where(distance == 1.0, 0.8, 1.0)
    level[1, 1, 4], level[1, 1, 7] = 0.7, 0.9
    faint, noise = deficits(level, distance)
    assert noise < 1e-4
    np.testing.assert_allclose(faint[1, 1, [4, 7]], 0.1, atol=3e-4)
    assert np.count_nonzero(np.abs(faint) > 1e-3) == 2


def test_an_inclusion_counts_little():
    distance = np.full((3, 3, 3), 3.0, np.float32)
    level = np.ones(distance.shape)
    level[1, 1, 1] = 4.0
    faint, _ = deficits(level, distance)
    np.testing.assert_allclose(faint[1, 1, 1], 1 - MAX_LEVEL, atol=3e-4)


@pytest.mark.parametrize(("sigma", "share"), [(0.0, 1.0), (1.0, 2.0)])
def test_noise_is_that_of_the_mean_over_a_neck(sigma, share):
    """White noise of 0.02: over a cube of 27 voxels 0.02/√27, times 3.  Correlated noise of 0.02 averages less."""
    white = np.random.default_rng(0).normal(size=(30, 30, 30))
    noise = ndimage.gaussian_filter(white, sigma) if sigma else white
    distance = np.full(noise.shape, 4.0, np.float32)
    _, found = deficits(1 + 0.02 * noise / noise.std(), distance)
    assert found > 0.9 * share * 0.02 / np.sqrt(3)
    assert sigma or found < 1.1 * 0.02 / np.sqrt(3)


def test_no_core():
    faint, noise = deficits(np.ones((2, 2, 2)), np.zeros((2, 2, 2), np.float32))
    assert not faint.any()
    assert noise == 0.0


def test_a_layer_in_which_all_grains_are_fainter_is_no_valley():
    """Two layers of grains; all of the lower one, and one grain of the upper one, are fainter half-way up."""
    shape = (40, 160, 160)
    distance = np.full(shape, 5.0, np.float32)
    distance[19:21] = distance[:, ::20] = distance[:, :, ::20] = 0
    level = np.where(distance > 0, 1.0, 0.0).astype(np.float32)
    level[8:12] -= 0.05
    level[28:32, 41:60, 41:60] -= 0.05
    level[distance == 0] = 0

    def measured(blurred):
        valleys = Valleys.of(lambda block, reach: block.gather(level, reach, 0), distance, Work(), blurred)
        faint = np.zeros(shape, np.float32)
        for block in blocks_of(shape):
            faint[block.box] = valleys.deficits(block)[1:-1, 1:-1, 1:-1]
        return faint[10, 50, 50], faint[30, 50, 50], faint[30, 90, 90]

    np.testing.assert_allclose(measured(False), [0.05, 0.05, 0.0], atol=3e-4)
    np.testing.assert_allclose(measured(True), [0.0, 0.05, 0.0], atol=2e-3)
