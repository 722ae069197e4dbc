"""Kept, gained and lost contacts; sliding, rolling and twisting of known motions."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from grainmotion.errors import InputError
from grainmotion.mechanics.contact_changes import contact_changes
from grainmotion.mechanics.contacts import contacts
from grainmotion.rotations import rotation_matrix
from spheres import known_motions, sphere_grains

RADIUS = 8.0
AXIS = np.array([1.0, 0.6, 0.3]) / np.linalg.norm([1.0, 0.6, 0.3])
ACROSS = np.cross(AXIS, [0, 0, 1.0]) / np.linalg.norm(np.cross(AXIS, [0, 0, 1.0]))


@pytest.fixture(scope="module")
def touching():
    """Two spheres in contact, and their contacts in the reference."""
    grains = sphere_grains(np.outer([-1, 1], AXIS) * RADIUS, [RADIUS] * 2, (46, 46, 46), blur=0.7)
    return grains, contacts(grains)


def changes_of(touching, shifts, rotations, **options):
    grains, before = touching
    motions = known_motions(grains.centers, shifts, rotations, **options)
    return contact_changes(before, contacts(grains, motions), motions)


@pytest.mark.parametrize("degrees", [2.0, 10.0, 20.0])
def test_a_sphere_that_rolls_around_another_does_not_slide(touching, degrees):
    """No slip: the second turns by 2φ when it goes around the first, at rest, by φ.  What is left is of third order."""
    phi = np.deg2rad(degrees)
    branch = np.diff(touching[0].centers, axis=0)[0]
    shift = rotation_matrix(phi * ACROSS) @ branch - branch
    found = changes_of(touching, [np.zeros(3), shift], [np.zeros(3), 2 * phi * ACROSS])
    assert list(found.changes) == ["kept"]
    assert np.rad2deg(found.rollings[0]) == pytest.approx(2 * degrees, abs=0.1)
    assert abs(np.rad2deg(found.twistings[0])) < 3 * degrees / 20 + 0.5
    assert np.linalg.norm(found.slidings[0]) < 0.02 + 0.6 * RADIUS * phi**3
    assert abs(found.normal_displacements[0]) < 0.02 + 0.6 * RADIUS * phi**3


def test_sliding_has_the_direction_of_the_second_grain(touching):
    found = changes_of(touching, [-0.5 * ACROSS, 0.7 * ACROSS], np.zeros((2, 3)))
    np.testing.assert_allclose(found.slidings[0], 1.2 * ACROSS, atol=0.12)
    assert found.normal_displacements[0] == pytest.approx(0, abs=0.12)
    assert found.rollings[0] == 0


def test_grains_that_turn_alike_in_place_slide(touching):
    """Both turn by ω without moving: the surfaces pass each other by 2 ω R, and nothing rolls."""
    w = np.deg2rad(3.0)
    found = changes_of(touching, np.zeros((2, 3)), [w * ACROSS] * 2)
    expected = np.cross(w * ACROSS, -2 * RADIUS * AXIS)  # of the second against the first
    np.testing.assert_allclose(found.slidings[0], expected, atol=0.05)
    assert found.rollings[0] == pytest.approx(0, abs=1e-12)


def test_gears_roll_without_sliding(touching):
    """They turn by opposite angles: the surfaces go together, the relative rotation is twice the angle."""
    w = np.deg2rad(3.0)
    found = changes_of(touching, np.zeros((2, 3)), [-w * ACROSS, w * ACROSS])
    assert np.linalg.norm(found.slidings[0]) < 0.02
    assert np.rad2deg(found.rollings[0]) == pytest.approx(6, abs=0.05)


def test_twisting_has_the_sign_of_the_second_grain(touching):
    found = changes_of(touching, np.zeros((2, 3)), [np.zeros(3), np.deg2rad(4.0) * AXIS])
    assert np.rad2deg(found.twistings[0]) == pytest.approx(4, abs=0.1)
    assert np.rad2deg(found.rollings[0]) < 0.4
    assert np.linalg.norm(found.slidings[0]) < 0.05


def test_a_common_rigid_motion_is_no_relative_motion(touching):
    w = np.deg2rad([20.0, -30, 50])
    shift = touching[0].centers @ (rotation_matrix(w) - np.eye(3)).T + [1.0, 2, 3]
    found = changes_of(touching, shift, np.tile(w, (2, 1)))
    assert list(found.changes) == ["kept"]
    assert np.abs(found.slidings).max() < 1e-9
    assert np.abs(found.normal_displacements).max() < 1e-9
    assert found.rollings[0] < 1e-9


def test_lost_gained_and_unknown(touching):
    grains, before = touching
    apart = known_motions(grains.centers, np.outer([0, 1.5], AXIS))
    far = known_motions(grains.centers, np.outer([0, 9.0], AXIS))
    for motions in (apart, far):
        found = contact_changes(before, contacts(grains, motions), motions)
        assert list(found.changes) == ["lost"]
    assert found.normal_displacements[0] == pytest.approx(9, abs=0.2)
    assert np.isnan(found.state_gaps[0])
    still = known_motions(grains.centers, np.zeros((2, 3)))
    gained = contact_changes(contacts(grains, apart), contacts(grains, still), still)
    assert list(gained.changes) == ["gained"]
    gone = known_motions(grains.centers, np.zeros((2, 3)), statuses=["converged", "left-field"])
    lost = contact_changes(before, contacts(grains, gone), gone)
    assert list(lost.changes) == ["unknown"]
    assert np.isnan(lost.slidings).all()


def test_without_a_rotation_nothing_is_said_of_sliding(touching):
    grains, before = touching
    motions = known_motions(grains.centers, np.zeros((2, 3)), statuses=["ambiguous", "converged"])
    found = contact_changes(before, contacts(grains, motions), motions)
    assert list(found.changes) == ["kept"]
    assert np.isnan(found.rollings).all()
    assert np.isnan(found.slidings).all()


def test_standard_deviations_are_those_of_draws(touching):
    grains, before = touching
    sd = np.array([0.05] * 3 + [0.01] * 3)
    shift, turn = np.array([[0, 0, 0], 0.6 * ACROSS]), np.array([[0, 0, 0], np.deg2rad(8) * ACROSS])
    clean = replace(known_motions(grains.centers, shift, turn), covariances=np.tile(np.diag(sd**2), (2, 1, 1)))
    state = contacts(grains, clean)
    told = contact_changes(before, state, clean)
    random, drawn = np.random.default_rng(0), []
    for _ in range(400):
        noise = random.normal(0, 1, (2, 6)) * sd
        moved = replace(clean, translations=shift + noise[:, :3], rotations=turn + noise[:, 3:])
        found = contact_changes(before, state, moved)
        drawn.append([found.normal_displacements[0], np.linalg.norm(found.slidings[0]), found.rollings[0],
                      found.twistings[0]])  # fmt: skip
    expected = [told.normal_sds[0], told.sliding_sds[0], told.rolling_sds[0], told.twisting_sds[0]]
    np.testing.assert_allclose(np.std(drawn, axis=0), expected, rtol=0.12)


def test_tables_without_pairs(touching):
    grains, _ = touching
    nothing = known_motions(grains.centers, np.zeros((2, 3)), statuses=["absent", "absent"])
    state = contacts(grains, nothing)
    assert len(contact_changes(state, state, nothing).to_dataframe()) == 0


def test_contacts_and_motions_of_other_grains_are_refused(touching):
    grains, before = touching
    motions = known_motions(grains.centers, np.zeros((2, 3)), np.zeros((2, 3)))
    others = replace(motions, labels=motions.labels + 100)
    with pytest.raises(InputError, match=r"contact_changes\(motions\): none of its grains is in reference"):
        contact_changes(before, before, others)
    with pytest.raises(InputError, match=r"contact_changes\(state\): none"):
        contact_changes(before, replace(before, labels=before.labels + 100), motions)


def test_exchanged_contacts_are_refused(touching):
    grains, before = touching
    motions = known_motions(grains.centers, [np.zeros(3), 0.5 * AXIS], np.zeros((2, 3)))
    with pytest.raises(InputError, match=r"contact_changes\(state\): its grains stand where they stood"):
        contact_changes(contacts(grains, motions), before, motions)
