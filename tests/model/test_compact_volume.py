"""Compact voxels of grains (`model.compact_volume`): rounding, and projection batch by batch."""

from dataclasses import replace

import numpy as np
import pytest

import many_small_grains as many
from grainmotion.backends import cpu
from grainmotion.model.compact_volume import LARGEST_WHOLE_NUMBER, CompactVolume
from grainmotion.model.grains import GrainSet
from grainmotion.model.volume import Volume
from grainmotion.projection.footprints import footprint_patches
from grainmotion.projection.grain_arrays import GrainArrays
from grainmotion.projection.grains import differentiate_patches, project_patches


def noisy_ball(edge=11):
    rng = np.random.default_rng(3)
    places = np.indices((edge, edge + 2, edge + 1)) - edge / 2
    array = np.where((places**2).sum(axis=0) < 16, 1 + 0.2 * rng.normal(size=places.shape[1:]), 0)
    array[3] = 0
    return Volume(array.astype(np.float32), 0.5, (1.0, 2.0, 3.0))


def test_voxels_are_those_of_the_volume_to_a_rounding():
    volume = noisy_ball()
    compact = CompactVolume.of(volume)
    largest = float(np.abs(volume.array).max())
    np.testing.assert_allclose(compact.array, volume.array, atol=0.51 * largest / LARGEST_WHOLE_NUMBER)
    np.testing.assert_array_equal(compact.array == 0, np.rint(volume.array / compact.unit) == 0)
    np.testing.assert_array_equal(compact.origin, volume.origin)
    assert compact.nbytes < 0.4 * volume.array.nbytes


def test_rounding_twice_changes_nothing():
    once = CompactVolume.of(noisy_ball()).volume
    np.testing.assert_allclose(CompactVolume.of(once).array, once.array, rtol=1e-6)


def test_an_empty_volume_stays_empty():
    assert not CompactVolume.of(Volume.zeros((3, 4, 5), 1.0)).array.any()


@pytest.fixture
def both():
    """Grains with finer voxels as arrays, and the same kept compactly."""
    grains = many.block(3)
    fine = [CompactVolume.of(g.volume) for g in grains.grains]
    compact = GrainSet(tuple(replace(g, fine=f) for g, f in zip(grains.grains, fine, strict=True)))
    whole = GrainSet(tuple(replace(g, fine=f.volume) for g, f in zip(grains.grains, fine, strict=True)))
    return GrainArrays.of(whole, fine=True), GrainArrays.of(compact, fine=True)


@pytest.mark.parametrize("rows", [range(27), [5, 20, 5, 1]])
def test_projections_are_the_same_to_the_bit_in_any_batches(both, rows, monkeypatch):
    whole, compact = (arrays.select(list(rows)) for arrays in both)
    monkeypatch.setattr(cpu, "VOXELS_OF_A_PART", 3 * int(compact.shapes[0].prod()))
    geometry, pose = many.views(3), many.still(len(whole))
    patches = footprint_patches(whole, pose, geometry)
    arguments = pose, geometry, patches, "trilinear"
    np.testing.assert_array_equal(project_patches(compact, *arguments), project_patches(whole, *arguments))
    for one, other in zip(
        differentiate_patches(compact, *arguments), differentiate_patches(whole, *arguments), strict=True
    ):
        np.testing.assert_array_equal(one, other)
        assert one.any()
