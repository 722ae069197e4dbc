"""Porous grains through which the surface of a liquid goes are one grain each, up to their caps."""

import numpy as np
from scipy import ndimage

from grainmotion.model.volume import Volume
from grainmotion.segmentation.segment import segment

SHAPE, RADIUS, LIQUID, EXCESS, LEVEL = (76, 64, 64), 9.5, 0.4, 0.6, 37.4
PLACES = (
    (15, 21, 19), (15, 21, 43), (16, 43, 31),
    (37, 18, 31), (42, 41, 20), (30, 42, 43),
    (63, 21, 21), (61, 40, 42),
)  # fmt: skip
"""Centres z, y, x: three balls below the surface, three that it cuts, the last of them below its top, and two above."""


def scanned():
    """Balls that hold the liquid below its surface and air above it, blurred, with noise, and their true labels."""
    z, y, x = np.indices(SHAPE, dtype=float)
    truth, share = np.zeros(SHAPE, int), np.zeros(SHAPE)
    for label, place in enumerate(PLACES, start=1):
        distance = np.sqrt(sum((axis - p) ** 2 for axis, p in zip((z, y, x), place, strict=True)))
        share += np.clip(RADIUS - distance + 0.5, 0, 1)
        truth[distance < RADIUS] = label
    cylinder = np.clip(28 - np.hypot(y - 31.5, x - 31.5), 0, 1) * np.clip(LEVEL - z + 0.5, 0, 1)
    array = ndimage.gaussian_filter(EXCESS * share + LIQUID * cylinder, 0.7)
    array += np.random.default_rng(0).normal(0, 0.02, SHAPE)
    return Volume(np.maximum(array, 0).astype(np.float32), 0.1), truth


def test_grains_at_the_surface_are_one_each_up_to_their_caps():
    volume, truth = scanned()
    labels = segment(volume).labels
    assert labels.max() == len(PLACES)
    for label in range(1, len(PLACES) + 1):
        own = truth == label
        found = np.bincount(labels[own]).argmax()
        assert found > 0
        assert 2 * (own & (labels == found)).sum() / (own.sum() + (labels == found).sum()) > 0.93
        above = own & (np.arange(SHAPE[0]) > LEVEL + 0.5)[:, None, None]
        inner = above & ndimage.binary_erosion(own)
        assert not inner.any() or (labels[inner] == found).mean() > 0.9
