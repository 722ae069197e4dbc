"""Segmentation (`segmentation.segment`): touching grains, settings, border, refused volumes."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import ndimage

from grainmotion import simulate
from grainmotion.errors import InputError
from grainmotion.model.volume import Volume
from grainmotion.segmentation.border import border_labels
from grainmotion.segmentation.segment import segment
from grainmotion.segmentation.settings import SegmentSettings

SHAPE = (40, 44, 60)


def grid(shape=SHAPE):
    return np.meshgrid(*(np.arange(n) for n in shape), indexing="ij")


def ellipsoid(center, radii, shape=SHAPE):
    return sum(((g - c) / r) ** 2 for g, c, r in zip(grid(shape), center, radii, strict=True)) < 1


def scanned(solid, noise=0.05, seed=0) -> Volume:
    """A volume with blurred faces and noise, as SART gives it."""
    blurred = ndimage.gaussian_filter(solid.astype(float), 0.7)
    return Volume(np.clip(blurred + np.random.default_rng(seed).normal(0, noise, solid.shape), 0, None), 0.1)


def confusion(truth, labels):
    """Numbers of split, merged and missing grains; a part of at least a tenth of a grain counts."""
    counts = np.zeros((truth.max() + 1, labels.max() + 1), int)
    np.add.at(counts, (truth.ravel(), labels.ravel()), 1)
    part = counts[1:, 1:] > 0.1 * np.bincount(truth.ravel())[1:, None]
    return int((part.sum(1) > 1).sum()), int((part.sum(0) > 1).sum()), int((part.sum(1) == 0).sum())


class TestTouchingGrains:
    def test_two_touching_balls_are_two(self):
        a, b = ellipsoid((20, 22, 18), (11, 11, 11)), ellipsoid((20, 22, 39.5), (11, 11, 11))
        segmentation = segment(scanned(a | b))
        assert segmentation.labels.max() == 2
        assert confusion(np.where(a, 1, 0) + np.where(b & ~a, 2, 0), segmentation.labels) == (0, 0, 0)

    @pytest.mark.parametrize("radii", [(6, 6, 24), (14, 14, 4), (8, 15, 25)])
    def test_an_elongated_or_flat_grain_is_one(self, radii):
        assert segment(scanned(ellipsoid((20, 22, 30), radii))).labels.max() == 1

    def test_a_wedge_that_widens_at_both_ends_is_one(self):
        z, y, x = grid()
        solid = (abs(z - 20) < 9 + 0.12 * abs(x - 30)) & (abs(y - 22) < 10) & (abs(x - 30) < 24)
        assert segment(scanned(solid)).labels.max() == 1

    def test_two_boxes_that_touch_over_part_of_a_face_are_two(self):
        z, y, x = grid()
        low = (abs(z - 12) < 8) & (abs(y - 15) < 9) & (abs(x - 22) < 14)
        high = (abs(z - 28) < 8) & (abs(y - 29) < 9) & (abs(x - 38) < 14)
        segmentation = segment(scanned(low | high))
        assert confusion(low + 2 * high, segmentation.labels) == (0, 0, 0)
        assert segmentation.labels.max() == 2

    @pytest.mark.parametrize("gap", [0.0, 0.4])
    def test_faces_that_blur_joins_are_two_grains(self, gap):
        """A neck as wide as the grains; blur of a voxel leaves 0.84 of the attenuation in a gap of 0.4 voxels."""
        a, b = ellipsoid((20, 22, 26), (11, 11, 11)), ellipsoid((20, 22, 34), (11, 11, 11))
        solid = (a | b).astype(float)
        solid[:, :, 30] *= 1 - gap
        noise = np.random.default_rng(0).normal(0, 0.04, solid.shape)
        volume = Volume(np.clip(ndimage.gaussian_filter(solid, 1.0) + noise, 0, None), 0.1)
        labels = segment(volume).labels
        assert labels.max() == (2 if gap else 1)
        if gap:
            x = np.arange(SHAPE[2])
            assert confusion((a & (x < 30)) + 2 * (b & (x > 30)), labels) == (0, 0, 0)

    def test_a_faint_grain_beside_a_bright_one_keeps_its_voxels(self):
        a, b = ellipsoid((20, 22, 18), (11, 11, 11)), ellipsoid((20, 22, 39.5), (11, 11, 11))
        segmentation = segment(scanned(np.where(a, 1.0, 0) + np.where(b & ~a, 0.65, 0)))
        assert segmentation.labels.max() == 2
        assert confusion(np.where(a, 1, 0) + np.where(b & ~a, 2, 0), segmentation.labels) == (0, 0, 0)

    @pytest.mark.parametrize(("seed", "voxels"), [(0, 20), (1, 30)])
    def test_a_packing_of_stones_has_no_errors(self, seed, voxels):
        rng = np.random.default_rng(seed)
        stones = [simulate.stone(int(i), 1.0, level=3) for i in rng.permutation(95)[:8]]
        particles = [simulate.Particle(s, 1.0) for s in stones]
        sample = simulate.pack(particles, simulate.PackingSettings(radius=1.2), seed)
        h = 1.0 / voxels
        centers = sample.centers
        center = (0.0, 0.0, float(centers[:, 2].mean()))
        height = int((np.ptp(centers[:, 2]) + 2.0) * voxels)
        empty = Volume.zeros((height, int(3 * voxels), int(3 * voxels)), h, center)
        truth = simulate.label_volume(sample, empty)
        volume = simulate.attenuation_volume(sample, empty, samples=2)
        noise = rng.normal(0, 0.07, volume.shape)
        volume = Volume(ndimage.gaussian_filter(volume.array, 0.7) + noise, h, center)
        assert confusion(truth, segment(volume).labels) == (0, 0, 0)


class TestSettings:
    def test_a_given_threshold_is_used(self):
        volume = scanned(ellipsoid((20, 22, 30), (10, 10, 10)))
        assert segment(volume, SegmentSettings(threshold=0.8)).threshold == 0.8
        low, high = (segment(volume, SegmentSettings(threshold=t)).labels for t in (0.3, 0.8))
        assert (low > 0).sum() > (high > 0).sum()

    def test_small_objects_are_removed(self):
        solid = ellipsoid((20, 22, 18), (11, 11, 11)) | ellipsoid((20, 22, 50), (2.5, 2.5, 2.5))
        volume = scanned(solid, noise=0)
        assert segment(volume, SegmentSettings(min_volume=200)).labels.max() == 1
        assert segment(volume, SegmentSettings(min_volume=20)).labels.max() == 2

    def test_cavities_are_filled(self):
        solid = ellipsoid((20, 22, 30), (14, 14, 14))
        hollow = solid & ~ellipsoid((20, 22, 30), (4, 4, 4))
        assert segment(scanned(hollow)).labels[20, 22, 30] == 1

    def test_inclusions_do_not_split_a_grain_and_are_part_of_it(self):
        solid = ellipsoid((20, 22, 30), (15, 15, 22)).astype(float)
        solid[ellipsoid((22, 24, 20), (5, 5, 5))] = 2.5
        solid[ellipsoid((18, 22, 40), (6, 6, 6))] = 0.1
        segmentation = segment(scanned(solid))
        assert segmentation.labels.max() == 1
        assert segmentation.labels[18, 22, 40] == 1

    def test_a_plate_two_voxels_thick_is_kept(self):
        z, y, x = grid()
        assert segment(scanned((abs(z - 19.5) < 1) & (abs(y - 22) < 15) & (abs(x - 30) < 20))).labels.max() == 1

    def test_a_weakly_attenuating_container_is_not_labelled(self):
        _, y, x = grid()
        wall = 0.3 * (abs(np.hypot(y - 21.5, x - 29.5) - 19) < 1.5)
        assert segment(scanned(np.maximum(wall, ellipsoid((20, 22, 30), (11, 11, 11))))).labels.max() == 1

    def test_hot_voxels_do_not_set_the_threshold(self):
        volume = scanned(ellipsoid((20, 22, 30), (11, 11, 11)))
        volume.array[2, 2, 2] = 200.0
        segmentation = segment(volume)
        assert segmentation.labels.max() == 1
        assert 0.3 < segmentation.threshold < 0.7

    def test_labels_run_from_1_without_gaps(self):
        solid = (
            ellipsoid((20, 22, 18), (9, 9, 9)) | ellipsoid((20, 22, 42), (9, 9, 9)) | ellipsoid((3, 3, 3), (2, 2, 2))
        )
        labels = segment(scanned(solid)).labels
        assert labels.dtype == np.int32
        assert np.array_equal(np.unique(labels), [0, 1, 2])

    def test_a_lower_oneness_merges_more(self):
        a, b = ellipsoid((20, 22, 20), (11, 11, 11)), ellipsoid((20, 22, 36), (11, 11, 11))
        volume = scanned(a | b)
        assert segment(volume, SegmentSettings(oneness=0.99)).labels.max() == 2
        assert segment(volume, SegmentSettings(oneness=0.05)).labels.max() == 1

    def test_the_same_volume_gives_the_same_labels(self):
        volume = scanned(ellipsoid((20, 22, 20), (11, 11, 11)) | ellipsoid((20, 22, 41), (11, 11, 11)))
        assert (segment(volume).labels == segment(volume).labels).all()


class TestBorder:
    def test_grains_cut_by_a_face_are_named(self):
        labels = np.zeros((20, 30, 30), np.int32)
        labels[0:4, 14:17, 14:17] = 1
        labels[8:12, 14:17, 14:17] = 2
        assert border_labels(labels) == (1,)

    def test_grains_cut_by_the_cylinder_are_named(self):
        labels = np.zeros((20, 30, 30), np.int32)
        labels[8:12, 3:7, 3:7] = 1
        labels[8:12, 14:17, 14:17] = 2
        assert border_labels(labels) == (1,)

    def test_segment_reports_border_grains(self):
        segmentation = segment(scanned(ellipsoid((2, 22, 30), (11, 11, 11))))
        assert segmentation.border == (1,)


class TestNoGrains:
    def test_a_uniform_volume_is_refused(self):
        with pytest.raises(InputError, match="no grains found"):
            segment(Volume.zeros((10, 10, 10), 0.1))

    @pytest.mark.parametrize("mean", [0.0, 0.5])
    def test_a_volume_of_noise_is_refused(self, mean):
        noise = np.random.default_rng(0).normal(mean, 0.1, (40, 40, 40))
        with pytest.raises(InputError, match=r"segment\.threshold.*noise"):
            segment(Volume(np.clip(noise, 0, None), 0.1))

    def test_a_threshold_above_all_voxels_is_refused(self):
        volume = scanned(ellipsoid((20, 22, 30), (10, 10, 10)))
        with pytest.raises(InputError, match=r"segment\.threshold.*lower"):
            segment(volume, SegmentSettings(threshold=50.0))
