"""Labels made by other software: pieces, necks, specks, and labels that do not lie on the grains."""

from __future__ import annotations

import re

import numpy as np
import pytest
from scipy import ndimage

from grainmotion.diagnosis.labels import check_labels, grains_in_doubt, in_doubt, necked_labels
from grainmotion.diagnosis.orientations import ORIENTATIONS, orientation_code, oriented
from grainmotion.errors import InputError
from grainmotion.model.finding import Level
from grainmotion.model.motions import Motions, Status
from grainmotion.model.volume import Volume

GRID = 40
BALLS = (
    (9, 9, 12, 6.5),
    (28, 12, 10, 7),
    (14, 27, 26, 7.5),
    (29, 28, 30, 6),
    (28, 14, 25, 6),
)  # z, y, x, radius, voxels


@pytest.fixture
def labels():
    """Five balls apart from each other."""
    z, y, x = np.indices((GRID,) * 3)
    image = np.zeros((GRID,) * 3, np.int32)
    for k, (bz, by, bx, radius) in enumerate(BALLS, start=1):
        image[(z - bz) ** 2 + (y - by) ** 2 + (x - bx) ** 2 <= radius**2] = k
    return image


@pytest.fixture
def volume(labels):
    """Their attenuation, with noise."""
    noise = np.random.default_rng(1).normal(0, 0.05, labels.shape)
    return Volume(np.where(labels > 0, 1.0, 0.0) + noise, 0.1)


def facts(findings):
    return " | ".join(f.fact for f in findings)


class TestRightLabels:
    def test_no_finding(self, volume, labels):
        assert check_labels(volume, labels) == ()

    def test_gaps_in_the_numbers(self, volume, labels):
        assert check_labels(volume, np.array([0, 3, 7, 12, 500, 501])[labels]) == ()

    def test_a_faint_grain(self, volume, labels):
        faint = Volume(np.where(labels == 2, 0.25, 1) * volume.array, 0.1)
        assert check_labels(faint, labels) == ()

    def test_a_slice(self, volume, labels):
        assert check_labels(Volume(volume.array[9:10], 0.1), labels[9:10]) == ()


class TestPieces:
    def test_two_grains_apart_in_one_label(self, volume, labels):
        labels[labels == 5] = 1
        (finding,) = check_labels(volume, labels)
        assert finding.level is Level.WARNING
        assert "label 1 holds two grains" in finding.fact

    def test_two_touching_grains_in_one_label(self, volume, labels):
        z, y, x = np.indices(labels.shape)
        labels[(z - 9) ** 2 + (y - 9) ** 2 + (x - 24) ** 2 <= 6**2] = 1
        labels[9, 9, 12:24] = 1
        assert set(necked_labels(labels)) == {1}
        assert "two touching grains" in facts(check_labels(Volume((labels > 0).astype(float), 0.1), labels))

    def test_motions_of_such_labels_are_poorly_determined(self, labels):
        labels[labels == 5] = 1
        motions = Motions.identity(np.array([1, 2]), np.zeros((2, 3)))
        motions.statuses[:] = Status.CONVERGED.value
        doubted = in_doubt(motions, grains_in_doubt(labels))
        assert doubted.statuses.tolist() == [Status.POORLY_DETERMINED.value, Status.CONVERGED.value]
        assert "2 separate pieces" in doubted.reasons[0]

    def test_small_labels_and_specks_are_told(self, volume, labels):
        labels[0, 0, ::4] = np.arange(10, 20)
        labels[38, 38, ::4] = 3
        findings = check_labels(volume, labels)
        assert "10 labels of too few voxels to be grains were dropped" in facts(findings)
        assert "specks apart from the grain were dropped from 1 label" in facts(findings)

    def test_a_binary_image(self, volume, labels):
        (finding,) = check_labels(volume, np.where(labels > 0, 255, 0))
        assert finding.level is Level.ERROR
        assert "binary image" in finding.fact
        assert "[segment]" in finding.remedy


class TestPlace:
    @pytest.mark.parametrize("k", [1, 2, 3, 6, 9, 17, 30, 41])
    def test_axes_in_another_order(self, volume, labels, k):
        """The remedy is an expression that gives the right labels."""
        orientation = ORIENTATIONS[k]
        order, reverse = orientation
        undone = tuple(slice(None, None, -1 if r else 1) for r in reverse)
        given = labels[undone].transpose(np.argsort(order))
        np.testing.assert_array_equal(oriented(given, orientation), labels)
        (finding,) = check_labels(volume, given)
        assert finding.level is Level.ERROR
        assert orientation_code("labels", orientation) in finding.remedy

    @pytest.mark.parametrize("shift", [(3, 0, -2), (1, 1, 0), (0, 0, 1)])
    def test_shifted_labels(self, volume, labels, shift):
        (finding,) = check_labels(volume, np.roll(labels, shift, (0, 1, 2)))
        assert "off by" in finding.fact or "shifted" in finding.fact

    @pytest.mark.parametrize("blur", [0.7, 1.2])
    def test_labels_off_by_part_of_a_voxel(self, volume, labels, blur):
        moved = ndimage.shift(ndimage.gaussian_filter(volume.array, blur), (0, 0, 0.7), order=1)
        (finding,) = check_labels(Volume(moved, volume.voxel_size, volume.center), labels)
        assert finding.fact == "the labels are shifted against the volume"
        assert re.search(r"by about \(-?0\.[01], -?0\.[01], -0\.[6-9]\) voxels", finding.evidence)

    @pytest.mark.parametrize("steps", [1, 2, 3])
    @pytest.mark.parametrize("noise", [0.0, 0.15])
    def test_labels_that_end_within_the_grains_are_not_shifted(self, volume, labels, steps, noise):
        """As those of a program that erodes grains to part them: no attenuation tells where the middle is."""
        inner = np.where(ndimage.binary_erosion(labels > 0, iterations=steps), labels, 0)
        random = np.random.default_rng(steps)
        array = volume.array + random.normal(0, noise * volume.array.max(), volume.shape)
        found = check_labels(Volume(array, volume.voxel_size, volume.center), inner)
        assert not [f for f in found if "shifted" in f.fact or "do not lie" in f.fact]

    def test_one_label_on_air(self, volume, labels):
        labels[33:38, 2:8, 30:36] = 9
        (finding,) = check_labels(volume, labels)
        assert "1 label lies on air" in finding.fact

    def test_another_shape(self, volume, labels):
        with pytest.raises(InputError, match="shape"):
            check_labels(volume, labels[1:])


class TestBackground:
    """Air or liquid with a label of its own, as after a watershed without a mask."""

    @pytest.mark.parametrize("number", [1, 2, 77])
    def test_air_has_a_label(self, volume, labels, number):
        given = np.where(labels > 0, labels + 100, number)
        (finding,) = check_labels(volume, given)
        assert finding.level is Level.ERROR
        assert f"label {number} is what lies around the grains" in finding.fact
        assert f"labels == {number}, 0" in finding.remedy

    def test_watershed_lines_are_0(self, volume, labels):
        given = np.where(labels > 0, labels, 9)
        given[20] = 0
        (finding,) = check_labels(volume, given)
        assert "label 9 is what lies around" in finding.fact

    def test_grain_and_air_are_swapped(self, volume, labels):
        (finding,) = check_labels(volume, np.where(labels > 0, 0, 1))
        assert "label 1 is what lies around" in finding.fact

    def test_grey_values_in_place_of_attenuation(self, volume, labels):
        grey = Volume(20_000 + 5000 * volume.array, 0.1)
        (finding,) = check_labels(grey, np.where(labels > 0, labels, 9))
        assert "label 9" in finding.fact

    def test_a_labelled_tube_of_plastic_is_no_background(self, volume, labels):
        y, x = np.indices(labels.shape[1:])
        tube = np.hypot(y - 19.5, x - 19.5) > 17
        array, given = volume.array.copy(), labels.copy()
        outside = (given == 0) & tube
        array[outside] += 0.3
        given[outside] = 8
        assert outside.mean() > 0.2
        assert not any("around the grains" in f.fact for f in check_labels(Volume(array, 0.1), given))

    def test_a_large_dense_body_is_no_background(self, volume, labels):
        array = volume.array.copy()
        array[32:], labels[32:] = 1.5, 8
        assert not any("around the grains" in f.fact for f in check_labels(Volume(array, 0.1), labels))
