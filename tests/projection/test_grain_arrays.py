"""Grains as flat arrays: packing, selecting, coarsening, and what counts as planar."""

from dataclasses import replace

import numpy as np
import pytest

import three_lumps
from few_grains import PANEL, VOXEL, grain_set
from grainmotion.errors import InputError
from grainmotion.model.compact_volume import CompactVolume
from grainmotion.model.geometry import Geometry
from grainmotion.model.grains import GrainSet
from grainmotion.model.pose import Pose
from grainmotion.model.volume import Volume
from grainmotion.projection.footprints import footprint_patches
from grainmotion.projection.grain_arrays import GrainArrays, planar
from grainmotion.projection.grains import assemble, project_patches
from grainmotion.segmentation.extraction import grains_from_labels

GRAINS = GrainArrays.of(grain_set(3, finer=1))


def radiographs(grains, geometry):
    n = len(grains)
    pose = Pose(np.zeros((n, 3)), np.tile(np.eye(3), (n, 1, 1)))
    patches = footprint_patches(grains, pose, geometry)
    return assemble(project_patches(grains, pose, geometry, patches, "trilinear"), patches, geometry)


def slice_grains(height=0.0, thickness=1):
    array = np.ones((thickness, 6, 20), np.float32)
    labels = np.ones(array.shape, np.int64)
    labels[:, :, 8:12], labels[:, :, 12:] = 0, 2
    return GrainArrays.of(grains_from_labels(Volume(array, 1.0, (0.0, 0.0, height)), labels, reach=0, finer=1))


class TestSelect:
    def test_row_selected_twice_counts_twice(self):
        views = Geometry.cone([0.0, 70.0], PANEL, 4 * VOXEL, source_to_axis=40, source_to_detector=160)
        once, twice = (radiographs(GRAINS.select(rows), views) for rows in ([1], [1, 1]))
        np.testing.assert_allclose(twice, 2 * once, rtol=1e-6)
        assert GRAINS.select([2, 0]).images is GRAINS.images
        np.testing.assert_array_equal(GRAINS.select([2, 0]).centers, GRAINS.centers[[2, 0]])


class TestCoarsened:
    @pytest.mark.parametrize("factor", [2, 3])
    def test_coarse_radiographs_keep_mass_and_position(self, factor):
        """Mass is kept to 0.5 %, the centroid to 0.02 pixel; only fine detail is lost."""
        views = Geometry.cone([0.0, 70.0], PANEL, 4 * VOXEL, source_to_axis=40, source_to_detector=160)
        coarse = GRAINS.coarsened(factor)
        assert coarse.voxel_size == pytest.approx(factor * VOXEL)
        fine, blurred = radiographs(GRAINS, views).astype(float), radiographs(coarse, views).astype(float)
        np.testing.assert_allclose(blurred.sum(axis=(1, 2)), fine.sum(axis=(1, 2)), rtol=5e-3)
        for axis in (1, 2):
            index = np.arange(fine.shape[axis])
            centers = [np.tensordot(i.sum(axis=3 - axis), index, (1, 0)) / i.sum(axis=(1, 2)) for i in (fine, blurred)]
            np.testing.assert_allclose(centers[1], centers[0], atol=0.02)
        assert np.abs(blurred - fine).max() < 0.35 * fine.max()

    def test_factor_one_returns_the_same_grains(self):
        assert GRAINS.coarsened(1) is GRAINS


class TestPlanar:
    FLAT = Geometry.parallel([0.0, 30.0], (1, 40), 1.0)

    def test_one_slice_with_rays_in_its_plane(self):
        assert planar(slice_grains(), self.FLAT)
        fan = Geometry.cone([0.0, 30.0], (1, 40), 1.0, source_to_axis=100, source_to_detector=200)
        assert planar(slice_grains(), fan)

    @pytest.mark.parametrize(
        ("grains", "geometry"),
        [
            (slice_grains(thickness=2), FLAT),
            (slice_grains(height=0.5), FLAT),
            (slice_grains(), Geometry.parallel([0.0, 30.0], (2, 40), 1.0)),
            (slice_grains(), replace(FLAT, vectors=FLAT.vectors + 0.01 * np.eye(12)[2])),
        ],
        ids=["two slices", "beside the rays", "two rows", "rays that leave the plane"],
    )
    def test_other_samples_are_not_planar(self, grains, geometry):
        assert not planar(grains, geometry)


class TestVoxels:
    def test_contiguous_voxels_are_not_copied(self):
        """Voxels of extracted grains are stored contiguously already, finer ones too."""
        sample = grain_set()
        for fine in (False, True):
            arrays = GrainArrays.of(sample, fine=fine)
            volumes = [g.fine if fine else g.volume for g in sample.grains]
            assert all(np.shares_memory(arrays.images, v.array) for v in volumes)
            np.testing.assert_array_equal(arrays.images, np.concatenate([v.array.ravel() for v in volumes]))

    def test_separate_voxels_are_copied_into_one_array(self):
        sample = grain_set().without([1])
        arrays = GrainArrays.of(sample)
        for k, grain in enumerate(sample.grains):
            start, size = arrays.starts[k], grain.volume.array.size
            np.testing.assert_array_equal(arrays.images[start : start + size], grain.volume.array.ravel())


class TestExtents:
    """The planes between which a grain's voxels lie."""

    def test_extents_of_selected_and_coarsened_grains(self):
        arrays = GrainArrays.of(three_lumps.three_grains())
        selected = arrays.select([2, 0, 2])
        np.testing.assert_array_equal(selected.extents, arrays.extents[[2, 0, 2]])
        axes = arrays.extents[:, :, :3]
        np.testing.assert_allclose(axes[:, 1] - axes[:, 0], 7 + 2 * 1.02, rtol=1e-6)
        assert (arrays.coarsened(2).extents[:, 1, :3] < arrays.coarsened(2).shapes[:, ::-1] - 1).all()


class TestOf:
    def test_voxels_of_grains_are_stored_one_after_the_other(self):
        grains = three_lumps.three_grains()
        arrays = GrainArrays.of(grains)
        assert len(arrays) == 3
        for k, grain in enumerate(grains.grains):
            size = int(np.prod(arrays.shapes[k]))
            mine = arrays.images[arrays.starts[k] : arrays.starts[k] + size].reshape(arrays.shapes[k])
            np.testing.assert_array_equal(mine, grain.volume.array)
            np.testing.assert_allclose(arrays.corners[k] + grain.center, grain.volume.origin)

    def test_hulls_reach_the_outermost_voxels(self):
        grains = three_lumps.three_grains()
        for hull, grain in zip(GrainArrays.of(grains).hulls, grains.grains, strict=True):
            z, y, x = np.nonzero(grain.volume.array)
            low = grain.volume.origin + three_lumps.VOXEL * np.array([x.min(), y.min(), z.min()]) - grain.center
            high = grain.volume.origin + three_lumps.VOXEL * np.array([x.max(), y.max(), z.max()]) - grain.center
            np.testing.assert_allclose(hull.min(axis=0), low)
            np.testing.assert_allclose(hull.max(axis=0), high)

    def test_compact_grains_have_the_outlines_of_their_voxels(self):
        """From the ends of their lines, without the voxels themselves."""
        volumes = [grain.volume for grain in three_lumps.three_grains().grains]
        grains = [replace(grain, fine=CompactVolume.of(grain.volume)) for grain in three_lumps.three_grains().grains]
        plain = [replace(grain, fine=volume) for grain, volume in zip(grains, volumes, strict=True)]
        compact, dense = (GrainArrays.of(GrainSet(tuple(some)), fine=True) for some in (grains, plain))
        assert compact.compact is not None
        assert dense.compact is None
        np.testing.assert_array_equal(compact.extents, dense.extents)
        np.testing.assert_allclose(compact.hulls, dense.hulls, rtol=0, atol=1e-12)

    def test_values_do_not_depend_on_how_many_voxels_are_written_at_once(self, monkeypatch):
        grains = GrainSet(tuple(replace(g, fine=CompactVolume.of(g.volume)) for g in three_lumps.three_grains().grains))
        arrays = GrainArrays.of(grains, fine=True).select([0, 0, 1, 2, 2])
        views = Geometry.parallel((0.0, 50.0), (24, 32), three_lumps.VOXEL)
        pose = Pose(np.zeros((5, 3)), np.tile(np.eye(3), (5, 1, 1)))
        patches = footprint_patches(arrays, pose, views)
        values = []
        for most in (1, 1 << 19):
            monkeypatch.setattr("grainmotion.backends.cpu.VOXELS_OF_A_THREAD", most)
            values.append(project_patches(arrays, pose, views, patches, "trilinear"))
        assert values[0].any()
        np.testing.assert_array_equal(*values)

    def test_grain_with_too_many_voxels_is_refused(self, monkeypatch):
        size = int(GrainArrays.of(three_lumps.three_grains()).shapes[0].prod())
        monkeypatch.setattr("grainmotion.projection.grain_arrays.MAX_GRAIN_VOXELS", size)
        GrainArrays.of(three_lumps.three_grains())
        monkeypatch.setattr("grainmotion.projection.grain_arrays.MAX_GRAIN_VOXELS", size - 1)
        with pytest.raises(InputError, match="coarser"):
            GrainArrays.of(three_lumps.three_grains())
