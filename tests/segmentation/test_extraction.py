"""Extracting grains from a labelled volume (`segmentation.extraction`): mass, positions, background, refused labels."""

import numpy as np
import pytest
from scipy import ndimage

from grainmotion.errors import InputError
from grainmotion.kernels.layout import PADDING
from grainmotion.model.volume import Volume
from grainmotion.segmentation.extraction import grains_from_labels
from scenes import in_grid

VOXEL = 0.2


def put_back(grains, volume):
    """The sum of all grains' voxels on the volume's own grid."""
    total = np.zeros(volume.shape)
    for grain in grains.grains:
        first = np.rint((grain.volume.origin - volume.origin) / volume.voxel_size).astype(int)[::-1]
        inner = grain.volume.array[PADDING:-PADDING, PADDING:-PADDING, PADDING:-PADDING]
        box = tuple(slice(f + PADDING, f + PADDING + n) for f, n in zip(first, inner.shape, strict=True))
        total[box] += inner
    return total


@pytest.fixture
def two_blocks():
    """Two blocks of labels 3 and 7 with a border of unlabelled attenuation, off the origin."""
    rng = np.random.default_rng(0)
    array = np.zeros((12, 14, 20), np.float32)
    array[2:9, 3:10, 2:9] = rng.uniform(0.5, 1, (7, 7, 7))
    array[2:9, 3:10, 11:18] = rng.uniform(0.5, 1, (7, 7, 7))
    labels = np.zeros(array.shape, np.int32)
    labels[3:8, 4:9, 3:8] = 3
    labels[3:8, 4:9, 12:17] = 7
    return Volume(array, VOXEL, (5.0, -3.0, 1.0)), labels


class TestExtraction:
    def test_all_attenuation_is_assigned_once(self, two_blocks):
        volume, labels = two_blocks
        grains = grains_from_labels(volume, labels)
        np.testing.assert_array_equal(grains.labels, [3, 7])
        np.testing.assert_allclose(put_back(grains, volume), volume.array)

    def test_reach_limits_the_attenuation_that_is_assigned(self, two_blocks):
        volume, labels = two_blocks
        labelled_only = grains_from_labels(volume, labels, reach=0)
        np.testing.assert_allclose(put_back(labelled_only, volume), np.where(labels > 0, volume.array, 0))
        # the block's edges and corners are √2 and √3 voxels away
        reach_one = put_back(grains_from_labels(volume, labels, reach=1), volume)
        assert reach_one[2, 5, 5] == volume.array[2, 5, 5]
        assert reach_one[2, 3, 5] == 0
        reach_two = put_back(grains_from_labels(volume, labels, reach=2), volume)
        np.testing.assert_allclose(reach_two, volume.array)

    def test_unlabelled_voxels_go_to_the_nearest_grain(self):
        array = np.ones((5, 5, 9), np.float32)
        labels = np.zeros(array.shape, np.uint8)
        labels[:, :, :2], labels[:, :, 7:] = 1, 2
        left, right = grains_from_labels(Volume(array, 1.0), labels).grains
        assert left.volume.array.sum() == pytest.approx(25 * 4, abs=25)
        assert left.volume.array.sum() + right.volume.array.sum() == 25 * 9

    def test_centers_are_centres_of_mass(self, two_blocks):
        volume, labels = two_blocks
        z, y, x = (volume.origin[::-1, None] + VOXEL * np.arange(20)[None])[:, :20]
        for grain, columns in zip(
            grains_from_labels(volume, labels).grains, (slice(0, 10), slice(10, 20)), strict=True
        ):
            part = volume.array[:, :, columns].astype(float)
            by_hand = [
                (part.sum(axis=(0, 1)) @ x[columns]) / part.sum(),
                (part.sum(axis=(0, 2)) @ y[:14]) / part.sum(),
                (part.sum(axis=(1, 2)) @ z[:12]) / part.sum(),
            ]
            np.testing.assert_allclose(grain.center, by_hand, atol=1e-6)

    def test_padding_is_empty(self, two_blocks):
        for grain in grains_from_labels(*two_blocks).grains:
            inner = np.zeros(grain.volume.shape, bool)
            inner[PADDING:-PADDING, PADDING:-PADDING, PADDING:-PADDING] = True
            assert not grain.volume.array[~inner].any()
            assert grain.volume.array[inner].any()

    def test_a_grain_that_fills_the_whole_volume(self):
        volume = Volume(np.ones((3, 4, 5)), VOXEL, (1, 2, 3))
        (grain,) = grains_from_labels(volume, np.full((3, 4, 5), 9)).grains
        np.testing.assert_allclose(grain.center, [1, 2, 3])
        np.testing.assert_allclose(grain.volume.center, [1, 2, 3])
        assert grain.volume.shape == (7, 8, 9)

    @pytest.mark.parametrize("kind", [np.uint8, np.int16, np.uint16, np.int32, np.int64, np.uint32])
    def test_labels_of_any_integer_type(self, two_blocks, kind):
        volume, labels = two_blocks
        np.testing.assert_array_equal(grains_from_labels(volume, labels.astype(kind)).labels, [3, 7])

    def test_grains_at_the_border_are_flagged(self, two_blocks):
        flags = [g.touches_border for g in grains_from_labels(*two_blocks, border=[7]).grains]
        assert flags == [False, True]

    def test_a_label_without_attenuation_gives_no_grain(self, two_blocks):
        volume, labels = two_blocks
        labels[11, 13, 0] = 5
        with pytest.warns(UserWarning, match="1 labels of too few voxels are no grains: 5"):
            grains = grains_from_labels(volume, labels)
        np.testing.assert_array_equal(grains.labels, [3, 7])


class TestGrainSet:
    def test_number_centers_and_voxel_size(self, two_blocks):
        grains = grains_from_labels(*two_blocks)
        assert len(grains) == 2
        assert grains.centers.shape == (2, 3)
        assert grains.voxel_size == VOXEL
        assert grains.background is None


class TestRefused:
    def test_labels_of_another_shape(self, two_blocks):
        volume, labels = two_blocks
        with pytest.raises(InputError, match=r"labels: shape .* is not the volume's"):
            grains_from_labels(volume, labels[1:])

    def test_labels_of_zero_alone(self, two_blocks):
        with pytest.raises(InputError, match="no grains found"):
            grains_from_labels(two_blocks[0], np.zeros_like(two_blocks[1]))

    def test_all_labels_on_air(self):
        with pytest.raises(InputError, match="no grains found"):
            grains_from_labels(Volume.zeros((5, 5, 5), 1.0), np.ones((5, 5, 5), int))

    def test_labels_that_are_not_integers(self, two_blocks):
        volume, labels = two_blocks
        with pytest.raises(InputError, match=r"labels: .*float64.*integers"):
            grains_from_labels(volume, labels.astype(float))

    @pytest.mark.parametrize("wrong_label", [-1, 2_000_000_000])
    def test_labels_out_of_range(self, two_blocks, wrong_label):
        volume, labels = two_blocks
        with pytest.raises(InputError, match=rf"labels: they run from .*{wrong_label}.*from 1 on"):
            grains_from_labels(volume, np.where(labels == 7, wrong_label, labels).astype(np.int64))


class TestBackground:
    @pytest.fixture
    def tubed(self, two_blocks):
        """The two blocks, and a wall beyond their reach."""
        volume, labels = two_blocks
        array = np.pad(volume.array, ((0, 0), (0, 0), (0, 8)))
        array[:, :, 26] = 0.4
        return Volume(array, VOXEL, volume.center), np.pad(labels, ((0, 0), (0, 0), (0, 8)))

    @pytest.mark.parametrize(("background", "moves"), [("ignore", False), ("fixed", False), ("moving", True)])
    def test_unassigned_attenuation_is_the_background(self, tubed, background, moves):
        volume, labels = tubed
        grains = grains_from_labels(volume, labels, background=background)
        assert grains.background_moves is moves
        if background == "ignore":
            assert grains.background is None
            return
        rest = in_grid(grains.background, volume)
        np.testing.assert_allclose(put_back(grains, volume) + rest, volume.array, atol=1e-6)
        np.testing.assert_allclose(rest[:, :, 26], 0.4)
        near = ndimage.distance_transform_edt(labels == 0) <= 1  # voxels next to a grain never belong to the background
        assert not rest[near].any()

    def test_a_subset_of_grains_keeps_the_background(self, tubed):
        fewer = grains_from_labels(*tubed, background="moving").without([0])
        assert fewer.background_moves
        assert fewer.background is not None
