"""Footprints of moving grains on the detector: boxes of pixels to trace, and the visible fraction of grains."""

import numpy as np
import pytest

from grainmotion.kernels import footprints
from grainmotion.model.geometry import Geometry
from grainmotion.model.grains import GrainSet
from grainmotion.model.motions import Motions
from grainmotion.model.pose import Pose
from grainmotion.model.volume import Volume
from grainmotion.projection.footprints import footprint_patches
from grainmotion.projection.grain_arrays import GrainArrays
from grainmotion.projection.grains import assemble, differentiate_patches, project_patches, simulate_radiographs
from grainmotion.projection.volumes import project
from grainmotion.rotations import rotation_matrix, rotation_vector
from grainmotion.segmentation.extraction import grains_from_labels
from three_lumps import PANEL, VOXEL, scanner, shifted, three_grains, unmoved


class TestFootprints:
    def test_boxes_contain_every_pixel_behind_a_grain(self):
        """No pixel outside of a grain's box has a part of the grain in its ray."""
        grains = three_grains()
        arrays = GrainArrays.of(grains)
        pose = Pose(
            np.array([[0.1, 0, 0], [0, 0.2, 0], [0, 0, -0.1]]), rotation_matrix([[0.3, 0, 0], [0, 2, 1], [1, 1, 1]])
        )
        wide = scanner(shape=(70, 84))
        patches = footprint_patches(arrays, pose, wide)
        for grain in range(3):
            alone = GrainSet((grains.grains[grain],))
            motions = Motions.identity(alone.labels, alone.centers)
            motions.translations[:], motions.rotations[:] = (
                pose.translations[grain],
                rotation_vector(pose.matrices[grain]),
            )
            covered = simulate_radiographs(alone, motions, wide) > 0
            for i in range(2):
                rows, columns = np.nonzero(covered[i])
                ((_, _, r0, r1, c0, c1),) = patches.boxes[(patches.boxes[:, 0] == grain) & (patches.boxes[:, 1] == i)]
                assert r0 <= rows.min() <= rows.max() < r1
                assert c0 <= columns.min() <= columns.max() < c1
                # and the box is not much larger
                assert r1 - r0 <= rows.max() - rows.min() + 6
                assert c1 - c0 <= columns.max() - columns.min() + 6

    def test_boxes_stay_on_the_panel_and_jobs_in_the_boxes(self):
        arrays = GrainArrays.of(three_grains())
        for margin in (0, 5, 100):
            patches = footprint_patches(arrays, shifted(arrays, 1.0, 0, 0.9), scanner(), margin)
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

    def test_margin_adds_empty_pixels_only(self):
        arrays = GrainArrays.of(three_grains())
        pose, geometry = unmoved(arrays), scanner()
        bare, wide = footprint_patches(arrays, pose, geometry), footprint_patches(arrays, pose, geometry, 4)
        np.testing.assert_array_equal(bare.seen, wide.seen)
        assert wide.offsets[-1] > bare.offsets[-1]
        images = [assemble(project_patches(arrays, pose, geometry, p, "trilinear"), p, geometry) for p in (bare, wide)]
        np.testing.assert_array_equal(*images)
        assert np.abs(images[0]).sum() == pytest.approx(images[0].sum())

    @pytest.mark.parametrize(
        ("shift", "least", "most"),
        [((0, 0, 0), 1, 1), ((0, 0, 1.55), 0.3, 0.7), ((0, 0, 5), 0, 0), ((0, 0, -1e6), 0, 0), ((0, -31, 0), 0, 0)],
        ids=["on the panel", "half off", "off", "far off", "behind the source"],
    )
    def test_fraction_of_the_footprint_on_the_panel(self, shift, least, most):
        arrays = GrainArrays.of(three_grains())
        geometry = scanner(angles=[0.0])
        patches = footprint_patches(arrays, shifted(arrays, *shift), geometry)
        assert patches.seen.shape == (3, 1)
        assert all(signature[4].mutable for signature in footprints.extents.signatures)  # one view compiles nothing
        assert (patches.seen >= least).all()
        assert (patches.seen <= most).all()
        if most == 0:
            assert len(patches.boxes) == 0
            values, derivatives = differentiate_patches(arrays, shifted(arrays, *shift), geometry, patches, "trilinear")
            assert values.shape == (0,)
            assert derivatives.shape == (6, 0)
            assert not assemble(values, patches, geometry).any()

    def test_radiograph_of_a_small_detector_is_a_crop_of_a_large_one(self):
        grains = three_grains()
        motions = Motions.identity(grains.labels, grains.centers)
        motions.translations[:] = 0.6, 0.3, 1.2
        motions.rotations[:] = 0.4
        small, large = scanner(), scanner(shape=(70, 84))
        whole = simulate_radiographs(grains, motions, large)
        part = simulate_radiographs(grains, motions, small)
        np.testing.assert_allclose(part, whole[:, 20:50, 20:64], atol=2e-6)
        assert whole[:, 50:].any()

    def test_view_without_visible_grains_is_zero(self):
        grains = three_grains()
        away = scanner().vectors.copy()
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
        computed = simulate_radiographs(grains, Motions.identity(grains.labels, grains.centers), scanner())
        np.testing.assert_allclose(computed, project(volume, scanner()), atol=2e-6)
