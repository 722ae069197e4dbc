"""Compact voxels of grains (`model.compact_volume`): rounding, and projection batch by batch."""

from dataclasses import replace

import numpy as np
import pytest

import many_small_grains as many
from grainmotion.backends import cpu
from grainmotion.model.compact_volume import STEPS_ABOVE, STEPS_OF_MORE, CompactVolume
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


def with_a_dense_voxel():
    volume = noisy_ball()
    array = volume.array.copy()
    array[5, 6, 6] = 40
    return replace(volume, array=array)


@pytest.mark.parametrize(
    ("volume", "kind", "steps"),
    [(noisy_ball(), np.uint8, STEPS_ABOVE), (with_a_dense_voxel(), np.int16, STEPS_OF_MORE)],
)
def test_voxels_are_those_of_the_volume_to_a_rounding(volume, kind, steps):
    compact = CompactVolume.of(volume)
    largest = float(np.abs(volume.array).max())
    assert compact.values.dtype == kind
    np.testing.assert_allclose(compact.array, volume.array, atol=0.51 * largest / steps)
    np.testing.assert_array_equal(compact.array == 0, np.rint(volume.array / compact.unit) == 0)
    np.testing.assert_array_equal(compact.origin, volume.origin)
    assert compact.dtype == compact.array.dtype
    assert compact.nbytes < 0.4 * volume.array.nbytes


@pytest.mark.parametrize("lowest", [-0.01, -0.3, -2.0])
def test_negative_voxels_are_kept(lowest):
    volume = noisy_ball()
    array = volume.array.copy()
    array[5, 6, 5] = lowest
    compact = CompactVolume.of(replace(volume, array=array))
    assert compact.array[5, 6, 5] == pytest.approx(lowest, abs=0.51 * float(compact.unit))
    np.testing.assert_allclose(compact.array, array, atol=0.51 * compact.unit)


def test_rounding_is_no_bias():
    """Sums of attenuation, and so line integrals through many voxels, are kept far better than single voxels."""
    volume = noisy_ball(41)
    compact = CompactVolume.of(volume)
    count = np.count_nonzero(volume.array)
    expected = volume.array.sum(dtype=float)
    assert compact.array.sum(dtype=float) == pytest.approx(expected, abs=4 * float(compact.unit) * np.sqrt(count / 12))


@pytest.mark.parametrize("volume", [noisy_ball(), with_a_dense_voxel()])
def test_rounding_twice_changes_nothing(volume):
    once = CompactVolume.of(volume).volume
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
    monkeypatch.setattr(cpu, "MAX_VOXELS_OF_A_PART", 3 * int(compact.shapes[0].prod()))
    geometry, pose = many.views(3), many.still(len(whole))
    patches = footprint_patches(whole, pose, geometry)
    arguments = pose, geometry, patches, "trilinear"
    np.testing.assert_array_equal(project_patches(compact, *arguments), project_patches(whole, *arguments))
    for one, other in zip(
        differentiate_patches(compact, *arguments), differentiate_patches(whole, *arguments), strict=True
    ):
        np.testing.assert_array_equal(one, other)
        assert one.any()
