"""The liquid around grains: found with its attenuation, space and level; not found in samples without one."""

import numpy as np
import pytest
from scipy import ndimage

from grainmotion.model.volume import Volume
from grainmotion.segmentation import fluid
from grainmotion.segmentation.extraction import extract_grains, grains_from_labels
from grainmotion.segmentation.fluid import find_fluid
from grainmotion.segmentation.segment import Segmentation
from grainmotion.segmentation.settings import SegmentSettings

SHAPE, VOXEL, GRAIN, LIQUID = (48, 44, 44), 0.1, 1.0, 0.4
PLACES = ((12, 15, 16), (13, 29, 24), (26, 18, 27), (27, 27, 15), (37, 22, 22))  # z y x, voxels
RADIUS = 6.0


def sample(level=None, medium=LIQUID, texture=0.0, noise=0.04, seed=0):
    """Balls in an upright cylinder of a medium up to a level (layers), blurred, and their labels."""
    rng = np.random.default_rng(seed)
    z, y, x = np.indices(SHAPE, dtype=float)
    cylinder = np.clip(19.5 - np.hypot(y - 21.5, x - 21.5), 0, 1)
    if level is not None:
        cylinder = cylinder * np.clip(level - z + 0.5, 0, 1)
    filling = medium + texture * ndimage.gaussian_filter(rng.normal(size=SHAPE), 2.0) * 2.0**4.5
    array, labels = np.zeros(SHAPE), np.zeros(SHAPE, np.int32)
    occupied = np.zeros(SHAPE)
    for label, place in enumerate(PLACES, start=1):
        distance = np.sqrt(sum((axis - p) ** 2 for axis, p in zip((z, y, x), place, strict=True)))
        share = np.clip(RADIUS - distance + 0.5, 0, 1)
        array, occupied = array + GRAIN * share, occupied + share
        labels[distance < RADIUS] = label
    array += filling * cylinder * (1 - occupied)
    array = ndimage.gaussian_filter(array, 0.6) + ndimage.gaussian_filter(noise * rng.normal(size=SHAPE), 0.4)
    return Volume(np.maximum(array, 0).astype(np.float32), VOXEL), labels, cylinder


def test_liquid_is_found_with_its_attenuation_and_its_space():
    volume, labels, cylinder = sample()
    fluid = find_fluid(volume, labels)
    assert fluid is not None
    assert fluid.level is None
    assert fluid.attenuation == pytest.approx(LIQUID, rel=0.01)
    assert fluid.space.array.sum() == pytest.approx(cylinder.sum(), rel=0.01)


@pytest.mark.parametrize("level", [20.3, 26.8])
def test_level_is_found_to_a_fraction_of_a_voxel(level):
    volume, labels, cylinder = sample(level)
    fluid = find_fluid(volume, labels)
    assert fluid is not None
    assert fluid.level is not None
    assert (fluid.level - volume.origin[2]) / VOXEL == pytest.approx(level, abs=0.15)
    assert fluid.space.array[-1].sum() == pytest.approx(cylinder[5].sum(), rel=0.02)  # goes on above the level


@pytest.mark.parametrize("share", [0.15, 0.7])
def test_faint_and_strong_liquids_are_found(share):
    volume, labels, _ = sample(medium=share, noise=0.02)
    fluid = find_fluid(volume, labels)
    assert fluid is not None
    assert fluid.attenuation == pytest.approx(share, rel=0.02)


def test_a_dry_sample_has_no_liquid():
    volume, labels, _ = sample(medium=0.0)
    assert find_fluid(volume, labels) is None


def test_faint_neighbours_and_a_wall_are_no_liquid():
    volume, labels, _ = sample(medium=0.0)
    faint = np.isin(labels, (1, 3))
    y, x = np.indices(SHAPE[1:], dtype=float) - 21.5
    wall = (np.hypot(y, x) > 14) & (np.hypot(y, x) < 19)
    array = np.where(faint, 0.35 * volume.array, volume.array)
    array = np.where((labels == 0) & wall, 0.35, array)
    assert find_fluid(Volume(array, VOXEL), np.where(faint, 0, labels)) is None


def test_a_wall_about_as_dense_as_the_liquid_is_a_body():
    volume, labels, _ = sample(noise=0.02)
    y, x = np.indices(SHAPE[1:]) - 21.5
    wall = np.clip(19.5 - np.hypot(y, x), 0, 1) * np.clip(np.hypot(y, x) - 13.5, 0, 1) * ~(labels > 0)
    array = volume.array - ndimage.gaussian_filter(0.25 * LIQUID * wall, 0.6)
    grains = grains_from_labels(Volume(array.astype(np.float32), VOXEL), labels)
    assert grains.scene.fluid is not None
    assert grains.scene.fluid.attenuation == pytest.approx(LIQUID, rel=0.02)
    assert [body.name for body in grains.scene.bodies] == ["wall"]
    inner = grains.scene.fluid.space.array.sum(axis=0) > 0.5 * SHAPE[0]
    assert inner.sum() == pytest.approx(np.pi * 13.5**2, rel=0.2)


def test_fines_with_texture_are_no_liquid():
    volume, labels, _ = sample(texture=0.15)
    assert find_fluid(volume, labels) is None


def test_grains_and_liquid_add_up_to_the_volume_but_for_noise():
    volume, labels, _ = sample(noise=0.0)
    grains = grains_from_labels(volume, labels, finer=1)
    assert grains.scene.fluid is not None
    assert not grains.scene.bodies
    total = grains.scene.fluid.volume.array.copy()
    for grain in grains.grains:
        start = np.round((grain.volume.origin - volume.origin) / VOXEL).astype(int)[::-1]
        for index in np.argwhere(grain.volume.array):
            total[tuple(start + index)] += grain.volume.array[tuple(index)]
    assert np.abs(total - volume.array).max() < 0.15 * LIQUID
    assert np.abs((total - volume.array).sum()) < 0.006 * volume.array.sum()  # blur beyond the reach of the labels


def test_a_liquid_can_be_told_or_refused():
    volume, labels, _ = sample()
    segmented = Segmentation.of(labels)
    assert extract_grains(volume, segmented, SegmentSettings(finer=1, fluid="none")).scene.fluid is None
    assert extract_grains(volume, segmented, SegmentSettings(finer=1, fluid=0.4)).scene.fluid is not None


def test_some_slabs_of_a_tall_volume_tell_how_wet_it_is(monkeypatch):
    """A third of all shells is lit: three slabs of ten say so, as all of them do."""
    labels = np.zeros((80, 40, 40), np.int32)
    labels[4::8, 4::8, 4::8] = 1
    array = (np.random.default_rng(5).random(labels.shape) < 1 / 3).astype(np.float32)
    monkeypatch.setattr(fluid, "PLANES_OF_SHELLS", 8)
    shares = []
    for most in (10, 3):
        monkeypatch.setattr(fluid, "SLABS_OF_SHELLS", most)
        shares.append(fluid._lit_share(array, labels, 0.5))
    assert shares[0] != shares[1]
    np.testing.assert_allclose(shares, 1 / 3, atol=0.02)
