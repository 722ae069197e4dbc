"""Contacts from surfaces: gaps that are known, from which gap on two spheres are apart, moved grains, uncertainty."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from grainmotion.errors import InputError
from grainmotion.mechanics.contacts import contacts
from grainmotion.model.motions import Motions
from grainmotion.model.volume import Volume
from grainmotion.rotations import rotation_matrix
from grainmotion.segmentation.extraction import grains_from_labels
from spheres import known_motions, sphere_grains, voxelised

RADIUS = 8.0
SHAPE = (46, 46, 46)
AXES = [(1.0, 0, 0), (1.0, 0.6, 0.3), (1.0, 1.0, 1.0)]


def two_spheres(gap: float, axis: tuple[float, float, float] = AXES[1], **options: float):
    """Grains and centres of two spheres, ``gap`` voxels apart along ``axis``."""
    unit = np.array(axis) / np.linalg.norm(axis)
    centers = np.array([0.1, 0.2, -0.3]) + np.outer([-1, 1], unit) * (RADIUS + gap / 2)
    return sphere_grains(centers, [RADIUS, RADIUS], SHAPE, **options), centers, unit


@pytest.mark.parametrize("blur", [0.0, 0.7])
@pytest.mark.parametrize("axis", AXES)
def test_gaps_of_two_spheres(axis, blur):
    """Gaps from 0 to 2 voxels are measured within 0.3 voxel; the largest errors are along an axis of the grid."""
    for gap in (0.0, 0.5, 1.0, 2.0):
        grains, _, _ = two_spheres(gap, axis, blur=blur)
        found = contacts(grains)
        assert len(found) == 1
        assert found.gaps[0] == pytest.approx(gap + 0.1, abs=0.25)


@pytest.mark.parametrize(("gap", "kind"), [(-0.5, "contact"), (0.0, "contact"), (1.0, "open"), (2.0, "open")])
@pytest.mark.parametrize("axis", AXES)
def test_from_which_gap_on_spheres_are_apart(gap, kind, axis):
    """Labels share faces up to a gap of about a voxel; here that is open."""
    grains, _, _ = two_spheres(gap, axis, blur=0.7)
    assert list(contacts(grains).kinds) == [kind]


def test_a_gap_near_the_tolerance_is_indeterminate():
    grains, _, _ = two_spheres(0.6, blur=0.7)
    assert list(contacts(grains).kinds) == ["indeterminate"]
    assert list(contacts(grains, tolerance=1.2).kinds) == ["contact"]


def test_place_normal_and_branch():
    grains, centers, unit = two_spheres(0.3, blur=0.7)
    found = contacts(grains)
    assert found.pairs.tolist() == [[1, 2]]
    np.testing.assert_allclose(found.points[0], centers.mean(axis=0), atol=0.15)
    assert np.rad2deg(np.arccos(found.normals[0] @ unit)) < 3
    np.testing.assert_allclose(found.branches[0], centers[1] - centers[0], atol=0.05)


def test_moved_grains_part_by_as_much_as_they_move():
    """The second sphere leaves along the line of centres, both turned; the gap grows by the same, to 0.05 voxel."""
    grains, _, unit = two_spheres(1.0, blur=0.7)
    before = contacts(grains)
    turn = np.deg2rad([[3.0, 1, -2], [-1, 4, 2]])
    for step in (-1.0, 0.5, 1.0):
        motions = known_motions(grains.centers, np.outer([0, step], unit), turn)
        after = contacts(grains, motions)
        assert after.gaps[0] - before.gaps[0] == pytest.approx(step, abs=0.12)


def test_a_common_rigid_motion_changes_no_contact():
    grains, _, _ = two_spheres(0.0, blur=0.7)
    w = np.deg2rad([20.0, -30, 50])
    shift = grains.centers @ (rotation_matrix(w) - np.eye(3)).T + [1.0, 2, 3]
    before, after = contacts(grains), contacts(grains, known_motions(grains.centers, shift, np.tile(w, (2, 1))))
    np.testing.assert_allclose(after.gaps, before.gaps, atol=1e-9)
    np.testing.assert_allclose(after.normals, before.normals @ rotation_matrix(w).T, atol=1e-9)
    np.testing.assert_allclose(after.branches, before.branches @ rotation_matrix(w).T, atol=1e-9)
    np.testing.assert_array_equal(after.kinds, before.kinds)


def test_the_standard_deviation_of_a_gap_is_that_of_the_motions():
    """Independent errors of 0.2 along the normal of both grains: √2 · 0.2, beside 0.1 of the surfaces."""
    grains, _, _ = two_spheres(0.8)
    motions = known_motions(grains.centers, np.zeros((2, 3)))
    only_u = np.diag([1.0, 1, 1, 0, 0, 0]) * 0.2**2
    found = contacts(grains, replace(motions, covariances=np.tile(only_u, (2, 1, 1))))
    assert found.gap_sds[0] == pytest.approx(np.hypot(0.1, np.sqrt(2) * 0.2), rel=1e-3)
    assert list(found.kinds) == ["indeterminate"]
    unknown = contacts(grains, replace(motions, covariances=np.full((2, 6, 6), np.nan)))
    assert list(unknown.kinds) == ["indeterminate"]
    off_axis = np.diag([0, 0, 0, 1.0, 1, 1]) * 0.05**2
    turned = contacts(grains, replace(motions, covariances=np.tile(off_axis, (2, 1, 1))))
    assert turned.gap_sds[0] < 0.12  # a sphere that turns changes no gap


def test_an_overlap_that_no_rigid_grains_have_is_told():
    grains, _, unit = two_spheres(0.0)
    found = contacts(grains, known_motions(grains.centers, np.outer([0, -3.0], unit)))
    assert list(found.kinds) == ["overlap"]
    assert found.gaps[0] < -2


def test_grains_without_a_place_are_told():
    grains, _, _ = two_spheres(0.0)
    motions = known_motions(grains.centers, np.zeros((2, 3)), statuses=["converged", "absent"])
    found = contacts(grains, motions)
    assert len(found) == 0
    assert found.left_out == ((2, "translation not to use: absent"),)
    half = known_motions(grains.centers[:1], np.zeros((1, 3)))
    assert contacts(grains, half).left_out == ((2, "translation not to use: not among the motions"),)
    nothing = contacts(grains, Motions.identity(np.zeros(0, dtype=int), np.zeros((0, 3))))
    assert (len(nothing), len(nothing.left_out), len(nothing.to_dataframe())) == (0, 2, 0)


def test_wrong_input_is_named():
    grains, _, _ = two_spheres(0.0)
    with pytest.raises(InputError, match=r"labels \[3\] are not among the grains"):
        contacts(grains, known_motions(np.zeros((3, 3)), np.zeros((3, 3))))
    with pytest.raises(InputError, match="tolerance: must be > 0, got nan"):
        contacts(grains, tolerance=float("nan"))


def test_a_slice_has_no_contacts_and_says_so():
    array, labels = voxelised(np.array([[-5.0, 0, 0], [5, 0, 0]]), np.array([5.0, 5.0]), (1, 20, 32))
    found = contacts(grains_from_labels(Volume(array, 1.0), labels))
    assert len(found) == 0
    assert [label for label, reason in found.left_out if "slice" in reason] == [1, 2]


@pytest.mark.parametrize("share", [1.0, 0.9, 0.6])
def test_a_grain_inside_another_is_an_overlap(share):
    """At the same place their surfaces coincide, which is no contact."""
    grains, _, _ = two_spheres(0.0)
    shift = np.array([np.zeros(3), share * (grains.centers[0] - grains.centers[1])])
    assert list(contacts(grains, known_motions(grains.centers, shift)).kinds) == ["overlap"]


def test_a_small_grain_deep_inside_a_large_one_is_an_overlap():
    grains = sphere_grains([[-10.0, 0, 0], [7, 0, 0]], [13.0, 4.0], (36, 36, 56))
    shift = np.array([np.zeros(3), grains.centers[0] - grains.centers[1] + [1.0, 0.5, 0]])
    assert list(contacts(grains, known_motions(grains.centers, shift)).kinds) == ["overlap"]
