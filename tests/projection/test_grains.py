"""Radiographs of volumes and moving grains: which pixels are walked, and what is left out."""

from dataclasses import replace

import numpy as np
import pytest

from grainmotion.errors import InputError
from grainmotion.kernels import grain_ray_tracing
from grainmotion.model.geometry import Geometry
from grainmotion.model.grains import Grain, GrainSet
from grainmotion.model.motions import Motions
from grainmotion.model.pose import Pose
from grainmotion.model.volume import Volume
from grainmotion.projection.footprints import footprint_patches
from grainmotion.projection.grain_arrays import GrainArrays
from grainmotion.projection.grains import assemble, differentiate_patches, project_patches, simulate_radiographs
from grainmotion.projection.volumes import back_project, project
from grainmotion.rotations import recenter, rotation_matrix, rotation_vector
from grainmotion.segmentation.extraction import grains_from_labels

PANEL = (30, 44)
VOXEL = 0.1


def stage(angles=(0.0, 60.0), shape=PANEL):
    return Geometry.cone(angles, shape, 4 * VOXEL, source_to_axis=30, source_to_detector=120)


def three_grains(finer=1, reach=0):
    """Labels 5, 2 and 9 in this volume: three lumps side by side along x."""
    rng = np.random.default_rng(0)
    array = np.zeros((12, 12, 32), np.float32)
    labels = np.zeros(array.shape, np.int32)
    for label, x in ((5, 2), (2, 12), (9, 22)):
        array[2:10, 2:10, x : x + 8] = rng.uniform(0.5, 1, (8, 8, 8))
        labels[2:10, 2:10, x : x + 8] = label
    return grains_from_labels(Volume(array, VOXEL, (0.1, 0.0, 0.05)), labels, reach=reach, finer=finer)


def still(grains):
    n = len(grains)
    return Pose(np.zeros((n, 3)), np.tile(np.eye(3), (n, 1, 1)))


def shifted(grains, *translation):
    pose = still(grains)
    pose.translations[:] = translation
    return pose


class TestShadows:
    def test_every_shaded_pixel_is_walked(self):
        """A panel with a rim of two pixels more on every side sees nothing that the smaller boxes missed."""
        grains = three_grains()
        packed = GrainArrays.of(grains)
        pose = Pose(
            np.array([[0.1, 0, 0], [0, 0.2, 0], [0, 0, -0.1]]), rotation_matrix([[0.3, 0, 0], [0, 2, 1], [1, 1, 1]])
        )
        wide = stage(shape=(70, 84))
        patches = footprint_patches(packed, pose, wide)
        for grain in range(3):
            alone = GrainSet((grains.grains[grain],))
            motions = Motions.identity(alone.labels, alone.centers)
            motions.translations[:], motions.rotations[:] = (
                pose.translations[grain],
                rotation_vector(pose.matrices[grain]),
            )
            seen = simulate_radiographs(alone, motions, wide) > 0
            for i in range(2):
                rows, columns = np.nonzero(seen[i])
                ((_, _, r0, r1, c0, c1),) = patches.boxes[(patches.boxes[:, 0] == grain) & (patches.boxes[:, 1] == i)]
                assert r0 <= rows.min() <= rows.max() < r1
                assert c0 <= columns.min() <= columns.max() < c1
                # and not many more
                assert r1 - r0 <= rows.max() - rows.min() + 6
                assert c1 - c0 <= columns.max() - columns.min() + 6

    def test_boxes_stay_on_the_panel_and_jobs_in_the_boxes(self):
        packed = GrainArrays.of(three_grains())
        for margin in (0, 5, 100):
            patches = footprint_patches(packed, shifted(packed, 1.0, 0, 0.9), stage(), margin)
            b, j = patches.boxes, patches.jobs
            assert (b[:, 2] >= 0).all()
            assert (b[:, 4] >= 0).all()
            assert (b[:, 3] <= 30).all()
            assert (b[:, 5] <= 44).all()
            owner = b[j[:, 0]]
            assert ((owner[:, 2] <= j[:, 1]) & (j[:, 1] < owner[:, 3])).all()
            assert ((owner[:, 4] <= j[:, 2]) & (j[:, 2] < j[:, 3]) & (j[:, 3] <= owner[:, 5])).all()
            sizes = (b[:, 3] - b[:, 2]) * (b[:, 5] - b[:, 4])
            np.testing.assert_array_equal(patches.offsets, np.concatenate([[0], np.cumsum(sizes)]))

    def test_a_margin_adds_empty_pixels_only(self):
        packed = GrainArrays.of(three_grains())
        pose, geometry = still(packed), stage()
        bare, wide = footprint_patches(packed, pose, geometry), footprint_patches(packed, pose, geometry, 4)
        np.testing.assert_array_equal(bare.seen, wide.seen)
        assert wide.offsets[-1] > bare.offsets[-1]
        images = [assemble(project_patches(packed, pose, geometry, p, "trilinear"), p, geometry) for p in (bare, wide)]
        np.testing.assert_array_equal(*images)
        assert np.abs(images[0]).sum() == pytest.approx(images[0].sum())

    @pytest.mark.parametrize(
        ("shift", "least", "most"),
        [((0, 0, 0), 1, 1), ((0, 0, 1.55), 0.3, 0.7), ((0, 0, 5), 0, 0), ((0, 0, -1e6), 0, 0), ((0, -31, 0), 0, 0)],
        ids=["on the panel", "half off", "off", "far off", "behind the source"],
    )
    def test_share_of_the_shadow_on_the_panel(self, shift, least, most):
        packed = GrainArrays.of(three_grains())
        geometry = stage(angles=[0.0])
        patches = footprint_patches(packed, shifted(packed, *shift), geometry)
        assert patches.seen.shape == (3, 1)
        assert (patches.seen >= least).all()
        assert (patches.seen <= most).all()
        if most == 0:
            assert len(patches.boxes) == 0
            values, slopes = differentiate_patches(packed, shifted(packed, *shift), geometry, patches, "trilinear")
            assert values.shape == (0,)
            assert slopes.shape == (6, 0)
            assert not assemble(values, patches, geometry).any()

    def test_partly_off_the_panel_is_a_cut_of_the_larger_radiograph(self):
        grains = three_grains()
        motions = Motions.identity(grains.labels, grains.centers)
        motions.translations[:] = 0.6, 0.3, 1.2
        motions.rotations[:] = 0.4
        small, large = stage(), stage(shape=(70, 84))
        whole = simulate_radiographs(grains, motions, large)
        cut = simulate_radiographs(grains, motions, small)
        np.testing.assert_allclose(cut, whole[:, 20:50, 20:64], atol=2e-6)
        assert whole[:, 50:].any()

    def test_a_view_in_which_no_grain_is_visible(self):
        grains = three_grains()
        away = stage().vectors.copy()
        away[1, 3:6] += 40 * away[1, 9:12]
        geometry = Geometry(away, PANEL)
        images = simulate_radiographs(grains, Motions.identity(grains.labels, grains.centers), geometry)
        assert images[0].any()
        assert not images[1].any()

    def test_negative_voxels_count_as_grain(self):
        """Other software leaves negative noise in air; a hull of positive voxels alone would cut it off."""
        array = np.zeros((9, 9, 15), np.float32)
        array[3:6, 3:6, 1:5], array[3:6, 3:6, 5:14] = 1, -0.1
        volume = Volume(array, VOXEL)
        grains = grains_from_labels(volume, (array != 0).astype(np.int8), reach=0, finer=1)
        found = simulate_radiographs(grains, Motions.identity(grains.labels, grains.centers), stage())
        np.testing.assert_allclose(found, project(volume, stage()), atol=2e-6)


def whole_box(packed):
    """The same grains as if every voxel of their crops counted."""
    faces = np.array([[np.zeros(3), shape[::-1] - 1] for shape in packed.shapes])
    corners = np.stack(np.meshgrid(*[(0, 1)] * 3), -1).reshape(-1, 3)
    spots = np.array([np.where(corners, high, low) for low, high in faces]) @ grain_ray_tracing.DIRECTIONS.T.astype(
        float
    )
    return replace(packed, extents=np.stack([spots.min(axis=1), spots.max(axis=1)], axis=1).astype(np.float32))


class TestExtents:
    """Planes that no ray needs to cross are skipped; what is skipped is empty."""

    @staticmethod
    def grain(kind, rng):
        array = np.zeros((9, 12, 10))
        inner = array[2:-2, 2:-2, 2:-2]
        if kind == "full":
            inner[:] = rng.uniform(-1, 1, inner.shape)
        elif kind == "few voxels":
            inner[tuple(rng.integers(0, n, 6) for n in inner.shape)] = 1
        elif kind == "one voxel":
            inner[2, 5, 1] = 1
        elif kind == "plate":
            inner[2] = rng.uniform(size=inner.shape[1:])
        elif kind == "rod, aslant":
            for k in range(5):
                inner[k, k + 1, k] = inner[k, k, k] = 1
        return array

    @pytest.mark.parametrize("projector", ["trilinear", "exact"])
    @pytest.mark.parametrize("beam", ["cone", "parallel"])
    @pytest.mark.parametrize("kind", ["full", "few voxels", "one voxel", "plate", "rod, aslant", "empty"])
    def test_what_is_skipped_is_empty(self, kind, beam, projector):
        rng = np.random.default_rng(3)
        angles = (0.0, 45.0, 90.0, 200.0)
        geometry = (
            Geometry.cone(angles, (34, 34), 4 * 0.6 * VOXEL, source_to_axis=30, source_to_detector=120)
            if beam == "cone"
            else Geometry.parallel(angles, (34, 34), 0.6 * VOXEL)
        )
        grain = Grain(1, Volume(self.grain(kind, rng), VOXEL), np.array([0.03, 0.0, -0.05]))
        packed = GrainArrays.of(GrainSet((grain,)))
        for turn in ([0, 0, 0], [0, 0, np.pi / 4], *rng.uniform(-3, 3, (6, 3))):
            pose = Pose(rng.uniform(-1, 1, (1, 3)) * VOXEL, rotation_matrix([turn]))
            patches = footprint_patches(packed, pose, geometry)
            found = differentiate_patches(packed, pose, geometry, patches, projector)
            wanted = differentiate_patches(whole_box(packed), pose, geometry, patches, projector)
            for one, other in zip(found, wanted, strict=True):
                np.testing.assert_allclose(one, other, rtol=0, atol=1e-12 * max(1.0, np.abs(other).max()))
            np.testing.assert_allclose(
                project_patches(packed, pose, geometry, patches, projector), found[0], rtol=0, atol=1e-12
            )
            assert found[0].any() == (kind != "empty")

    def test_they_follow_the_grain_through_coarser_voxels_and_selection(self):
        packed = GrainArrays.of(three_grains())
        some = packed.select([2, 0, 2])
        np.testing.assert_array_equal(some.extents, packed.extents[[2, 0, 2]])
        axes = packed.extents[:, :, :3]
        np.testing.assert_allclose(axes[:, 1] - axes[:, 0], 7 + 2 * 1.02, rtol=1e-6)
        assert (packed.coarsened(2).extents[:, 1, :3] < packed.coarsened(2).shapes[:, ::-1] - 1).all()

    def test_a_grain_of_too_many_voxels_is_refused(self, monkeypatch):
        size = int(GrainArrays.of(three_grains()).shapes[0].prod())
        monkeypatch.setattr("grainmotion.projection.grain_arrays.MAX_GRAIN_VOXELS", size)
        GrainArrays.of(three_grains())
        monkeypatch.setattr("grainmotion.projection.grain_arrays.MAX_GRAIN_VOXELS", size - 1)
        with pytest.raises(InputError, match="coarser"):
            GrainArrays.of(three_grains())


class TestSimulatedRadiographs:
    def test_unknown_motions_are_left_out(self):
        grains = three_grains()
        motions = Motions.identity(grains.labels, grains.centers)
        motions.translations[1] = np.nan
        others = GrainSet((grains.grains[0], grains.grains[2]))
        expected = simulate_radiographs(others, Motions.identity(others.labels, others.centers), stage())
        np.testing.assert_allclose(simulate_radiographs(grains, motions, stage()), expected, atol=1e-6)
        motions.translations[:] = np.nan
        assert not simulate_radiographs(grains, motions, stage()).any()

    def test_grains_of_other_labels_or_order_are_refused(self):
        grains = three_grains()
        motions = Motions.identity(grains.labels[::-1].copy(), grains.centers[::-1].copy())
        with pytest.raises(InputError, match="labels"):
            simulate_radiographs(grains, motions, stage())
        with pytest.raises(InputError, match="labels"):
            simulate_radiographs(grains, Motions.identity(grains.labels[:2], grains.centers[:2]), stage())

    def test_motions_about_other_centres_are_the_same_motions(self):
        grains = three_grains()
        motions = Motions.identity(grains.labels, grains.centers)
        motions.rotations[:], motions.translations[:] = 0.3, 0.1
        elsewhere = Motions.identity(grains.labels, grains.centers + 0.07)
        elsewhere.rotations[:] = 0.3
        elsewhere.translations[:] = recenter(motions.matrices, motions.translations, motions.centers, elsewhere.centers)
        one, other = (simulate_radiographs(grains, m, stage()) for m in (motions, elsewhere))
        np.testing.assert_allclose(one, other, atol=2e-6)

    def test_finer_voxels_hold_the_same_grains(self):
        """Grains have them unless told otherwise; their radiographs cast as much shadow, and are used."""
        still = Motions.identity(three_grains().labels, three_grains().centers)
        coarse, fine = (simulate_radiographs(three_grains(finer, 3), still, stage()) for finer in (1, 2))
        assert np.abs(fine - coarse).max() > 1e-3
        np.testing.assert_allclose(fine.sum(axis=(1, 2)), coarse.sum(axis=(1, 2)), rtol=2e-3)
        exact = [simulate_radiographs(three_grains(finer), still, stage(), projector="exact") for finer in (1, 2)]
        np.testing.assert_array_equal(*exact)

    def test_single_precision_stacks_of_views(self):
        grains = three_grains()
        found = simulate_radiographs(grains, Motions.identity(grains.labels, grains.centers), stage((0.0, 1.0, 2.0)))
        assert found.dtype == np.float32
        assert found.shape == (3, *PANEL)


class TestPacked:
    def test_the_grains_one_after_the_other(self):
        grains = three_grains()
        packed = GrainArrays.of(grains)
        assert len(packed) == 3
        for k, grain in enumerate(grains.grains):
            size = int(np.prod(packed.shapes[k]))
            mine = packed.images[packed.starts[k] : packed.starts[k] + size].reshape(packed.shapes[k])
            np.testing.assert_array_equal(mine, grain.volume.array)
            np.testing.assert_allclose(packed.corners[k] + grain.center, grain.volume.origin)

    def test_hulls_reach_the_outermost_voxels(self):
        grains = three_grains()
        for hull, grain in zip(GrainArrays.of(grains).hulls, grains.grains, strict=True):
            z, y, x = np.nonzero(grain.volume.array)
            low = grain.volume.origin + VOXEL * np.array([x.min(), y.min(), z.min()]) - grain.center
            high = grain.volume.origin + VOXEL * np.array([x.max(), y.max(), z.max()]) - grain.center
            np.testing.assert_allclose(hull.min(axis=0), low)
            np.testing.assert_allclose(hull.max(axis=0), high)


class TestWholeVolumes:
    def test_back_projection_takes_the_place_of_the_grid(self):
        grid = Volume.zeros((4, 5, 6), VOXEL, (0.3, 0.2, 0.1))
        back = back_project(np.ones((2, *PANEL), np.float64), stage(), grid)
        assert (back.shape, back.center) == ((4, 5, 6), (0.3, 0.2, 0.1))
        assert (back.array > 0).all()
        assert not grid.array.any()

    def test_a_volume_off_the_panel_has_no_shadow(self):
        volume = Volume(np.ones((4, 5, 6)), VOXEL, (0, 0, 50.0))
        assert not project(volume, stage()).any()
