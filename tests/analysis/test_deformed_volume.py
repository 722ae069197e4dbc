"""Volume of the deformed configuration (`analysis.deformed_volume`): identity, mass, motions, labels."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy import ndimage

import wet_sample
from grainmotion.analysis.deformed_volume import rebuild, typical_attenuation
from grainmotion.errors import InputError
from grainmotion.model.fluid import FluidFit
from grainmotion.model.grains import Grain, GrainSet
from grainmotion.model.motions import Motions, Status
from grainmotion.model.state_fit import StateFit
from grainmotion.model.volume import Volume
from grainmotion.rotations import recenter
from grainmotion.simulate.voxelise import attenuation_volume, label_volume
from scenes import one_body

H = 0.1  # voxel size, mm


def positions(volume: Volume) -> np.ndarray:
    """Centres of all voxels, (nz, ny, nx, 3), mm, x y z."""
    z, y, x = np.meshgrid(*(np.arange(n) for n in volume.shape), indexing="ij")
    return volume.origin + np.stack([x, y, z], axis=-1) * volume.voxel_size


def ellipsoid(label: int, center: tuple, radii: tuple, attenuation: float = 1.0) -> Grain:
    """An ellipsoid (mm) with its surface blurred over about two voxels."""
    n = 2 * (int(np.ceil(max(radii) / H)) + 4)
    box = Volume.zeros((n, n, n), H, tuple(np.round(np.array(center) / H) * H + H / 2))
    lever = (positions(box) - center) / radii
    depth = (1 - np.linalg.norm(lever, axis=-1)) * min(radii) / H
    array = attenuation / (1 + np.exp(-3 * np.clip(depth, -20, 20)))
    array[array < 1e-3 * attenuation] = 0
    volume = Volume(array, H, box.center)
    center_of_mass = (positions(volume) * volume.array[..., None]).sum((0, 1, 2)) / volume.array.sum()
    return Grain(label, volume, center_of_mass)


@pytest.fixture(scope="module")
def sample() -> GrainSet:
    """An ellipsoid and a denser sphere, labels 3 and 7."""
    return GrainSet(
        (ellipsoid(3, (-0.6, 0.1, 0.0), (0.4, 0.6, 0.5)), ellipsoid(7, (0.5, 0.0, 0.2), (0.4, 0.4, 0.4), 2.5))
    )


@pytest.fixture(scope="module")
def still(sample: GrainSet) -> Motions:
    """No motion, converged."""
    start = Motions.identity(sample.labels, sample.centers)
    return replace(start, statuses=np.full(len(sample), Status.CONVERGED.value, dtype="<U20"))


@pytest.fixture(scope="module")
def grid() -> Volume:
    return Volume.zeros((26, 28, 34), H, (0.0, 0.0, 0.0))


def mass_center(volume: Volume) -> np.ndarray:
    return (positions(volume) * volume.array[..., None]).sum((0, 1, 2)) / volume.array.sum()


class TestIdentity:
    def test_an_unmoved_grain_on_its_own_grid_is_unchanged(self, sample, still):
        grain = sample.grains[0]
        alone = GrainSet((grain,))
        motions = Motions.identity(alone.labels, alone.centers)
        motions = replace(motions, statuses=still.statuses[:1])
        volume, labels = rebuild(alone, motions, grain.volume)
        np.testing.assert_allclose(volume.array, grain.volume.array, atol=1e-6)
        np.testing.assert_array_equal(labels, np.where(grain.volume.array > typical_attenuation(grain) / 2, 3, 0))

    def test_grains_and_background_sum_to_the_reference(self, sample, still, grid):
        noise = np.random.default_rng(0).random(grid.shape).astype(np.float32)
        with_background = GrainSet(sample.grains, one_body(Volume(noise, H, grid.center)))
        bare, labels = rebuild(sample, still, grid)
        full, labels_full = rebuild(with_background, still, grid)
        np.testing.assert_allclose(full.array - bare.array, noise, atol=1e-6)
        np.testing.assert_array_equal(labels, labels_full)
        expected = sum(float(g.volume.array.sum()) for g in sample.grains)
        assert bare.array.sum() == pytest.approx(expected, rel=1e-6)

    def test_a_finer_grid_holds_the_same_mass(self, sample, still, grid):
        fine = Volume.zeros(tuple(2 * n for n in grid.shape), H / 2, grid.center)
        coarse_mass = rebuild(sample, still, grid)[0].array.sum() * H**3
        assert rebuild(sample, still, fine)[0].array.sum() * (H / 2) ** 3 == pytest.approx(coarse_mass, rel=1e-3)


class TestMotion:
    @pytest.mark.parametrize("rotation_deg", [(0, 0, 90), (25, -40, 10), (5, 170, 3)])
    def test_rotation_conserves_mass_and_centre(self, sample, still, grid, rotation_deg):
        rotated = replace(still, rotations=np.deg2rad([rotation_deg, rotation_deg]))
        before, after = rebuild(sample, still, grid)[0], rebuild(sample, rotated, grid)[0]
        assert after.array.sum() == pytest.approx(before.array.sum(), rel=1e-3)
        np.testing.assert_allclose(mass_center(after), mass_center(before), atol=2e-3 * H)

    def test_a_sphere_is_moved_to_its_place(self, sample, grid):
        sphere = GrainSet((sample.grains[1],))
        u = np.array([[-0.234, 0.311, -0.152]])
        motions = replace(
            Motions.identity(sphere.labels, sphere.centers),
            translations=u,
            rotations=np.deg2rad([[30.0, 20.0, -50.0]]),
            statuses=np.array([Status.POORLY_DETERMINED.value], dtype="<U20"),
        )
        volume, labels = rebuild(sphere, motions, grid)
        expected = sphere.centers[0] + u[0]
        np.testing.assert_allclose(mass_center(volume), expected, atol=5e-3 * H)
        np.testing.assert_allclose(positions(volume)[labels == 7].mean(0), expected, atol=0.05 * H)

    def test_rotations_are_right_handed(self, grid):
        """A rotation by 90° about z moves a bar along x to y, with its denser +x end at +y."""
        bar = np.zeros((9, 9, 15), np.float32)
        bar[3:6, 3:6, 3:11] = 1
        bar[3:6, 3:6, 11] = 5
        volume = Volume(bar, H)
        grain = Grain(1, volume, np.zeros(3))
        motions = replace(
            Motions.identity(np.array([1]), np.zeros((1, 3))),
            rotations=np.array([[0, 0, np.pi / 2]]),
            statuses=np.array(["converged"], dtype="<U20"),
        )
        box = Volume.zeros((9, 15, 9), H)
        moved, labels = rebuild(GrainSet((grain,)), motions, box)
        np.testing.assert_allclose(moved.array[:, :, ::-1].transpose(0, 2, 1), bar, atol=1e-5)
        assert moved.array[4, 11, 4] == pytest.approx(5)
        assert (labels > 0).sum() == np.count_nonzero(bar > typical_attenuation(grain) / 2)


class TestLabels:
    def test_labels_follow_the_grains(self, sample, still, grid):
        _, before = rebuild(sample, still, grid)
        shift = replace(still, translations=np.array([[0.0, 0.2, 0.3], [0.0, -0.3, 0.1]]))
        _, after = rebuild(sample, shift, grid)
        np.testing.assert_array_equal(np.roll(before == 3, (3, 2), axis=(0, 1)), after == 3)
        np.testing.assert_array_equal(np.roll(before == 7, (1, -3), axis=(0, 1)), after == 7)
        assert after.dtype == np.int32

    def test_a_shared_voxel_has_the_label_of_the_larger_contribution(self, sample, still, grid):
        """The denser sphere overlaps the ellipsoid and keeps all of its voxels."""
        pushed = replace(still, translations=np.array([[0.0, 0.0, 0.0], [-0.5, 0.0, 0.0]]))
        _, alone = rebuild(GrainSet(sample.grains[1:]), select_rows(pushed, [1]), grid)
        _, both = rebuild(sample, pushed, grid)
        np.testing.assert_array_equal(both == 7, alone == 7)

    def test_typical_attenuation_does_not_depend_on_an_inclusion_or_a_halo(self):
        array = np.zeros((12, 12, 12), np.float32)
        array[2:10, 2:10, 2:10] = 0.1
        array[3:9, 3:9, 3:9] = 1.0
        array[5, 5, 5:8] = 20.0
        assert typical_attenuation(Grain(1, Volume(array, H), np.zeros(3))) == pytest.approx(1.0)


class TestOmittedGrains:
    @pytest.mark.parametrize("status", ["left-field", "not-fitted"])
    def test_grains_are_omitted_by_status(self, sample, still, grid, status):
        motions = replace(still, statuses=np.array([status, "converged"], dtype="<U20"))
        _, labels = rebuild(sample, motions, grid)
        assert set(np.unique(labels)) == {0, 7}

    @pytest.mark.parametrize("part", ["translations", "rotations"])
    def test_grains_without_a_motion_are_omitted(self, sample, still, grid, part):
        unknown = np.array([[0.0, 0.0, 0.0], [np.nan, np.nan, np.nan]])
        volume, labels = rebuild(sample, replace(still, **{part: unknown}), grid)
        assert set(np.unique(labels)) == {0, 3}
        assert np.isfinite(volume.array).all()

    def test_grains_that_moved_off_the_grid_are_omitted(self, sample, still, grid):
        away = replace(still, translations=np.array([[50.0, 0.0, 0.0], [0.0, 0.0, 0.0]]))
        assert set(np.unique(rebuild(sample, away, grid)[1])) == {0, 7}

    def test_an_unknown_label_is_an_error(self, sample, grid):
        other_motions = Motions.identity(np.array([99]), np.zeros((1, 3)))
        with pytest.raises(InputError, match=r"\[99\]"):
            rebuild(sample, other_motions, grid)


def select_rows(motions: Motions, rows: list[int]) -> Motions:
    parts = (
        "labels",
        "centers",
        "translations",
        "rotations",
        "covariances",
        "statuses",
        "residuals",
        "iterations",
    )
    return replace(
        motions,
        **{p: getattr(motions, p)[rows] for p in parts},
        reasons=tuple(motions.reasons[i] for i in rows),
    )


def test_a_strained_grain_keeps_its_mass_and_spreads_along_its_strain(sample, still, grid):
    strains = np.zeros((2, 6))
    strains[:, 0] = 0.2
    strained = replace(still, strains=strains, strain_covariances=np.zeros((2, 6, 6)))
    grid = Volume.zeros(tuple(2 * n for n in grid.shape), H / 2, grid.center)  # samples of 0.83 voxels count unevenly
    before, after = rebuild(sample, still, grid)[0], rebuild(sample, strained, grid)[0]
    assert after.array.sum() == pytest.approx(before.array.sum(), rel=1e-3)
    only = GrainSet(sample.grains[1:])
    spreads = []
    for each in (still, strained):
        volume = rebuild(only, each.for_grains(only.labels, only.centers), grid)[0]
        away = positions(volume)[..., 0] - mass_center(volume)[0]
        spreads.append((away**2 * volume.array).sum() / volume.array.sum())
    assert spreads[1] / spreads[0] == pytest.approx(1.2**2, rel=0.02)


@pytest.fixture(scope="module")
def wet():
    """Grains of a wet reference, what they did, and the stones after it."""
    stones = wet_sample.stones()
    truth, later = wet_sample.moved(stones)
    grains = wet_sample.reference(stones)
    rows = [int(np.linalg.norm(truth.centers - c, axis=1).argmin()) for c in grains.centers]
    shifts = recenter(truth.matrices[rows], truth.translations[rows], truth.centers[rows], grains.centers)
    still = Motions.identity(grains.labels, grains.centers)
    statuses = np.full(len(grains), Status.CONVERGED.value, dtype="<U20")
    return grains, replace(still, translations=shifts, rotations=truth.rotations[rows], statuses=statuses), later


@pytest.mark.parametrize("level", [None, 0.0])
def test_a_liquid_is_that_of_the_state(wet, level):
    grains, motions, later = wet
    if level is not None:
        motions = replace(motions, fit=StateFit(fluid=FluidFit(wet_sample.LIQUID, level, 1.0)))
        later = wet_sample.solid(later, level)
    grid = Volume.zeros(wet_sample.SHAPE, wet_sample.VOXEL)
    volume, labels = rebuild(grains, motions, grid)
    z, y, x = (grid.origin[k] + grid.voxel_size * np.arange(grid.shape[2 - k]) for k in (2, 1, 0))
    below = (z < (np.inf if level is None else level))[:, None, None]
    filled = (np.hypot(y[:, None], x) < wet_sample.RADIUS) & below
    truth = label_volume(later, grid)
    expected = attenuation_volume(later, grid).array + wet_sample.LIQUID * filled
    inner, pores = (ndimage.binary_erosion(where, iterations=2) for where in (truth > 0, truth == 0))
    for where in (inner & filled, inner & ~filled, pores & filled, pores & ~filled):
        if where.any():
            assert volume.array[where].mean() == pytest.approx(expected[where].mean(), abs=0.02)
    assert (labels == truth)[truth > 0].mean() > 0.9
