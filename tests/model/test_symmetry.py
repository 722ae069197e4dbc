"""Axes about which bodies look the same (`model.symmetry`)."""

import numpy as np
import pytest

from grainmotion.model.symmetry import symmetry_axis
from grainmotion.model.volume import Volume

Z, Y, X = np.mgrid[:24, :64, :64] - np.array([11.5, 31.5, 31.5])[:, None, None, None]
NOISE = 0.05 * np.random.default_rng(0).standard_normal(Z.shape)


def tube(oval=1.0, bright=0.0, inner=20.0):
    radius = np.hypot(X, oval * Y)
    return np.clip(27.5 - radius, 0, 1) * np.clip(radius - inner, 0, 1) * (1 + bright * (X > 10))


@pytest.mark.parametrize("array", [tube(), tube(inner=-1.0)], ids=["tube", "disc"])
def test_round_bodies_have_an_axis(array):
    axis = symmetry_axis(Volume(array + NOISE, 0.1))
    np.testing.assert_allclose(np.abs(axis), [0, 0, 1], atol=0.02)


def test_a_lying_one_has_a_lying_axis():
    array = np.moveaxis(tube(), 0, 2)
    np.testing.assert_allclose(np.abs(symmetry_axis(Volume(array, 0.1))), [1, 0, 0], atol=0.02)


@pytest.mark.parametrize(
    "array",
    [tube(oval=1.05), tube(bright=0.3), np.ones((10, 40, 44)), np.ones((10, 40, 40)), np.zeros((4, 4, 4))],
    ids=["oval", "brighter on one side", "block", "square", "empty"],
)
def test_others_have_none(array):
    assert symmetry_axis(Volume(np.pad(array, 3), 0.1)) is None
