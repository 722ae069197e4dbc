"""Grains on finer voxels (`segmentation.label_refinement`): upsampling, separation at contacts, mass."""

import numpy as np
import pytest
from scipy import ndimage
from skimage.segmentation import expand_labels, watershed

from grainmotion.kernels import contested_voxels
from grainmotion.kernels.layout import PADDING
from grainmotion.model.volume import Volume
from grainmotion.segmentation.extraction import grains_from_labels
from grainmotion.segmentation.label_growth import grown_crop
from grainmotion.segmentation.label_refinement import fine_cut, upsampled
from grainmotion.simulate import Ellipsoid, Particle, Sample, attenuation_volume, label_volume

VOXEL = 0.1
REACH = 3.0


def fine_centres(shape, factor):
    """Positions of fine voxels in coarse indices, axis by axis."""
    return [(np.arange(factor * n) + 0.5) / factor - 0.5 for n in shape]


class TestSpline:
    @pytest.mark.parametrize("factor", [1, 2, 3])
    def test_cubic_polynomials_are_reproduced(self, factor):
        """Away from the mirrored edges, where a cubic is no longer one."""
        shape = (24, 26, 28)
        rng = np.random.default_rng(0)
        powers = rng.normal(size=(3, 4))

        def cubic(axes):
            z, y, x = (np.polynomial.polynomial.polyval(a / 20, c) for a, c in zip(axes, powers, strict=True))
            return z[:, None, None] * y[:, None] * x

        fine = upsampled(cubic([np.arange(n, dtype=float) for n in shape]), factor)
        expected = cubic(fine_centres(shape, factor))
        inner = tuple(slice(10 * factor, -10 * factor) for _ in shape)
        assert fine.shape == expected.shape
        np.testing.assert_allclose(fine[inner], expected[inner], atol=3e-6 * np.abs(expected).max())

    @pytest.mark.parametrize("factor", [2, 3])
    def test_the_sum_is_conserved(self, factor):
        array = np.random.default_rng(1).uniform(size=(9, 10, 11))
        array = np.pad(array, 12)  # so that nothing is cut off at the edge
        assert upsampled(array, factor).sum() / factor**3 == pytest.approx(array.sum(), rel=1e-6)

    def test_factor_one_changes_nothing(self):
        array = np.random.default_rng(2).uniform(size=(6, 7, 8))
        np.testing.assert_allclose(upsampled(array, 1), array, atol=1e-5)

    def test_precision_is_kept(self):
        assert upsampled(np.ones((5, 5, 5), np.float32), 2).dtype == np.float32

    def test_uniform_attenuation_stays_uniform(self):
        np.testing.assert_allclose(upsampled(np.full((5, 6, 7), 0.3), 3), 0.3, rtol=1e-5)


# ---------------------------------------------------------------------- grains
def balls(*places, radius=0.65):
    return Sample(tuple(Particle(Ellipsoid(np.array(p, float), np.full(3, radius), np.eye(3)), 1.0) for p in places))


def touching(axis=(1.0, 0.6, 0.3), radius=0.65):
    """Two balls 13 voxels across that touch in one point, oblique to the grid."""
    direction = np.array(axis) / np.linalg.norm(axis)
    middle = np.array([0.013, -0.021, 0.034])
    return balls(middle - radius * direction, middle + radius * direction, radius=radius)


GRID = Volume.zeros((36, 36, 44), VOXEL)


def true_parts(sample, grid, factor):
    """Attenuation of each grain on the fine voxels."""
    fine = Volume.zeros(tuple(factor * n for n in grid.shape), grid.voxel_size / factor, grid.center)
    parts = [attenuation_volume(Sample((p,)), fine).array.astype(float) for p in sample.particles]
    return parts


def wrong_mass(sample, labels, factor):
    """Share of the attenuation that labels on fine voxels assign to the wrong one of two grains."""
    one, two = true_parts(sample, GRID, factor)
    return (one[labels == 2].sum() + two[labels == 1].sum()) / (one.sum() + two.sum())


def whole_grown(labels, reach):
    return grown_crop(labels.astype(np.int32), reach, tuple(slice(0, n) for n in labels.shape))


def refined_labels(array, labels, factor, reach):
    """Labels of finer voxels, grain by grain; no voxel has two."""
    out, grown = np.zeros([factor * n for n in labels.shape], int), whole_grown(labels, reach)
    for label in np.unique(labels[labels > 0]):
        own, start = fine_cut(array + 1, labels, grown, label, factor, reach)  # no voxel is zero
        part = out[tuple(slice(a, a + n) for a, n in zip(start, own.shape, strict=True))]
        assert not (part[own != 0] > 0).any()
        part[own != 0] = label
    return out


def blurred(sample, sigma=0.7):
    """Attenuation of voxels, blurred as in a reconstruction."""
    return Volume(ndimage.gaussian_filter(attenuation_volume(sample, GRID).array, sigma), VOXEL)


class TestTouching:
    @pytest.mark.parametrize("blur", [0.0, 0.7])
    @pytest.mark.parametrize("axis", [(1.0, 0.6, 0.3), (0.2, 0.9, -0.5), (0.7, 0.7, 0.02)], ids=str)
    def test_grains_are_separated_at_their_contact(self, axis, blur):
        """With less wrong attenuation than nearest labels have."""
        sample = touching(axis)
        volume, labels = blurred(sample, blur), label_volume(sample, GRID)
        nearest = np.kron(expand_labels(labels, REACH), np.ones((2, 2, 2), labels.dtype))
        refined = refined_labels(volume.array, labels, 2, REACH)
        share = wrong_mass(sample, refined, 2)
        assert share < 1e-3
        assert share < 0.5 * wrong_mass(sample, nearest, 2)

    def test_labels_that_are_a_voxel_off_are_corrected(self):
        """Labels of a watershed on voxels are jagged at the contact; the minimum of the attenuation is not."""
        sample = touching()
        labels = label_volume(sample, GRID)
        rng = np.random.default_rng(3)
        grown = expand_labels(labels, 1.0)
        shifted = np.roll(grown, 1, axis=2)
        disturbed = np.where((grown > 0) & (shifted > 0) & (rng.uniform(size=labels.shape) < 0.5), shifted, labels)
        nearest = np.kron(expand_labels(disturbed, REACH), np.ones((2, 2, 2), labels.dtype))
        share = wrong_mass(sample, refined_labels(blurred(sample).array, disturbed, 2, REACH), 2)
        assert share < 1e-3
        assert share < 0.3 * wrong_mass(sample, nearest, 2)

    def test_separate_grains_get_the_nearest_label(self):
        sample = balls((-1.2, 0, 0), (1.2, 0, 0))
        labels = label_volume(sample, GRID)
        refined = refined_labels(attenuation_volume(sample, GRID).array, labels, 2, REACH)
        np.testing.assert_array_equal(refined, np.kron(expand_labels(labels, REACH), np.ones((2, 2, 2), int)))

    def test_reach_limits_the_labelled_voxels(self):
        sample = touching()
        labels = label_volume(sample, GRID)
        refined = refined_labels(attenuation_volume(sample, GRID).array, labels, 2, 0)
        np.testing.assert_array_equal(refined > 0, np.kron(labels, np.ones((2, 2, 2), int)) > 0)

    def test_thin_grains_keep_their_volume(self):
        """A flake two voxels thick, half a voxel from a ball on either side."""
        direction = np.array([1.0, 0, 0])
        flake = Particle(Ellipsoid(np.zeros(3), np.array([0.1, 0.6, 0.6]), np.eye(3)), 1.0)
        balls_beside = balls(-0.8 * direction, 0.8 * direction)
        sample = Sample((*balls_beside.particles, flake))
        volume, labels = attenuation_volume(sample, GRID), label_volume(sample, GRID)
        grains = grains_from_labels(volume, labels, reach=REACH)
        volume_of_flake = flake.shape.volume
        fine = grains.grains[2].fine
        assert fine.array.sum(dtype=float) * fine.voxel_size**3 == pytest.approx(volume_of_flake, rel=0.1)
        np.testing.assert_allclose(center_of_mass(fine), np.zeros(3), atol=0.02 * VOXEL)

    def test_a_grain_of_few_voxels_is_kept(self):
        labels = np.zeros((9, 9, 9), np.int32)
        labels[3:6, 3:6, 1:4], labels[4:6, 4:6, 4:6] = 1, 2
        grains = grains_from_labels(Volume((labels > 0).astype(np.float32), VOXEL), labels)
        assert len(grains) == 2
        assert all(g.fine is not None and g.fine.array.any() for g in grains.grains)


def center_of_mass(volume):
    array = volume.array.astype(float)
    axes = [volume.origin[k] + volume.voxel_size * np.arange(array.shape[2 - k]) for k in range(3)]
    sums = [array.sum(axis=tuple({0, 1, 2} - {2 - k})) for k in range(3)]
    return np.array([s @ a for s, a in zip(sums, axes, strict=True)]) / array.sum()


class TestFineGrains:
    @pytest.mark.parametrize("factor", [2, 3])
    def test_centre_of_mass_is_that_of_the_coarse_voxels(self, factor):
        """The centre of mass of the finer voxels is that of the coarse ones, wherever the volume is."""
        sample = balls((-0.61, 0.18, 0.07))
        volume, labels = attenuation_volume(sample, GRID), label_volume(sample, GRID)
        away = Volume(volume.array, VOXEL, (3.0, -2.0, 1.0))
        (grain,) = grains_from_labels(away, labels, finer=factor).grains
        assert grain.fine.voxel_size == pytest.approx(VOXEL / factor)
        np.testing.assert_allclose(center_of_mass(grain.fine), grain.center, atol=1e-3 * VOXEL)
        np.testing.assert_allclose(center_of_mass(grain.fine), [2.39, -1.82, 1.07], atol=0.02 * VOXEL)

    @pytest.mark.parametrize("factor", [2, 3])
    def test_all_attenuation_is_assigned_once(self, factor):
        sample = touching()
        volume, labels = blurred(sample), label_volume(sample, GRID)
        grains = grains_from_labels(volume, labels, reach=REACH, finer=factor)
        within = volume.array[expand_labels(labels, REACH) > 0].sum(dtype=float)
        assigned = sum(g.fine.array.sum(dtype=float) for g in grains.grains) / factor**3
        assert assigned == pytest.approx(within, rel=5e-3)
        each = [g.fine.array.sum(dtype=float) for g in grains.grains]
        assert each[0] == pytest.approx(each[1], rel=5e-3)
        assert not grains_per_voxel(grains, factor).max(initial=0) > 1

    def test_padding_is_empty_and_the_crop_tight(self):
        sample = touching()
        for grain in grains_from_labels(attenuation_volume(sample, GRID), label_volume(sample, GRID)).grains:
            inner = grain.fine.array[PADDING:-PADDING, PADDING:-PADDING, PADDING:-PADDING]
            assert np.count_nonzero(grain.fine.array) == np.count_nonzero(inner)
            for axis in range(3):
                ends = np.moveaxis(inner, axis, 0)[[0, -1]]
                assert ends.reshape(2, -1).any(axis=1).all()

    def test_no_finer_voxels_with_factor_one_or_for_a_slice(self):
        sample = balls((0, 0, 0))
        volume, labels = attenuation_volume(sample, GRID), label_volume(sample, GRID)
        assert grains_from_labels(volume, labels, finer=1).grains[0].fine is None
        flat = Volume(volume.array[18:19], VOXEL)
        assert grains_from_labels(flat, labels[18:19]).grains[0].fine is None


def grains_per_voxel(grains, factor):
    """Number of grains with attenuation in each fine voxel."""
    count = np.zeros([factor * n for n in GRID.shape], int)
    h = VOXEL / factor
    origin = GRID.origin - VOXEL / 2 + h / 2
    for grain in grains.grains:
        place = (grain.fine.origin - origin) / h
        np.testing.assert_allclose(place, np.rint(place), atol=1e-6)
        z, y, x = np.nonzero(grain.fine.array)
        i, j, k = np.rint(place[::-1]).astype(int)
        np.add.at(count, (z + i, y + j, x + k), 1)
    return count


class TestKernels:
    """Kernels give what scipy and scikit-image give on whole crops."""

    def test_contested_voxels_have_another_label_near(self):
        rng = np.random.default_rng(4)
        grown = ndimage.zoom(rng.integers(0, 4, size=(4, 5, 6)), 5, order=0).astype(np.int32)
        for distance in (1, 3):
            highest = ndimage.maximum_filter(grown, 2 * distance + 1)
            lowest = ndimage.minimum_filter(np.where(grown > 0, grown, 9), 2 * distance + 1)
            expected = (lowest < highest) & (grown > 0)
            np.testing.assert_array_equal(contested_voxels.find_contested(grown, distance), expected)

    def test_voxels_near_a_label(self):
        labels = np.zeros((9, 8, 14), np.int32)
        labels[2:4, 5, 6:8], labels[7, 1, 2] = 3, 2
        expected = ndimage.maximum_filter(labels == 3, 5)
        np.testing.assert_array_equal(contested_voxels.find_near(labels, 3, 2), expected)

    def test_flooding_is_the_watershed(self):
        """But for voxels of one step of attenuation."""
        rng = np.random.default_rng(5)
        values = ndimage.gaussian_filter(rng.normal(size=(20, 24, 22)), 2).astype(np.float32)
        markers = np.zeros(values.shape, np.int32)
        markers[3:6, 4:8, 3:9], markers[12:15, 15:20, 10:18] = contested_voxels.OWN_KIND, contested_voxels.OTHER_KIND
        mask = rng.uniform(size=values.shape) < 0.9
        kinds = np.where(mask, np.where(markers > 0, markers, contested_voxels.WANTING), contested_voxels.OUTSIDE)
        padded = np.pad(kinds.astype(np.uint8), 1)
        contested_voxels.flood(padded, contested_voxels.levels_of(values, values.min(), values.max()))
        flooded = padded[1:-1, 1:-1, 1:-1]
        flooded[flooded == contested_voxels.WANTING] = 0
        expected = watershed(-values, markers, mask=mask)
        assert (flooded != expected).mean() < 2e-3
