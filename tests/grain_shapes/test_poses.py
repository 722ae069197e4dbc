"""Poses and velocities of bodies, each sign from motions that are known."""

import dataclasses

import numpy as np
import pytest
from scipy.spatial import cKDTree
from test_mass_properties import BOX

from grainmotion.grain_shapes.mass_properties import mass_properties
from grainmotion.grain_shapes.poses import State, pose_table, poses
from grainmotion.grain_shapes.rigid_body import rigid_body
from grainmotion.grain_shapes.settings import DemSettings
from grainmotion.model.motions import Motions, Status
from grainmotion.rotations import rotation_matrix
from known_solids import PLACE, TURN, H, box, grain, voxels

PROPERTIES = {7: mass_properties(BOX.moved(rotation_matrix([0.3, -0.2, 0.5]), np.array([1.0, 2.0, 3.0])))}


def motions(translation, rotation, *, status=Status.CONVERGED, label=7, offset=(0.2, -0.1, 0.3)):
    """The motion of one grain, whose centre of mass is not that of its volume."""
    center = PROPERTIES[7].center + offset
    base = Motions.identity(np.array([label]), center[None])
    return dataclasses.replace(
        base, translations=np.array([translation], float), rotations=np.array([rotation], float),
        statuses=np.array([status.value]),
    )  # fmt: skip


def test_the_body_is_where_its_points_are():
    """A point of the reference carried by the motion is the same point of the body carried by the pose."""
    state = State("one", motions([0.4, -0.3, 0.2], [0.3, 0.6, -0.5]))
    before, after = poses(PROPERTIES, [state])
    corner = np.array([1.7, 2.2, 3.4])
    in_body = before.matrices[0].T @ (corner - before.positions[0])
    c = PROPERTIES[7].center + np.array([0.2, -0.1, 0.3])
    moved = rotation_matrix([0.3, 0.6, -0.5]) @ (corner - c) + [0.4, -0.3, 0.2] + c
    np.testing.assert_allclose(after.matrices[0] @ in_body + after.positions[0], moved, atol=1e-12)
    w, x, y, z = after.quaternions[0]  # a quaternion of the matrix, written out
    np.testing.assert_allclose(
        after.matrices[0][[0, 1, 0], [0, 0, 2]],
        [1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z + w * y)], atol=1e-12,
    )  # fmt: skip


def test_the_surface_moved_by_the_pose_is_the_moved_solid():
    solid = box(3.0, 2.4, 2.0)
    body = rigid_body(grain(voxels(solid)), DemSettings(shapes=("stl",)))
    rotation, shift = np.array([0.5, -0.4, 0.3]), np.array([2.0, 1.0, -3.0])
    move = Motions.identity(np.array([1]), PLACE[None])
    move = dataclasses.replace(
        move, translations=shift[None], rotations=rotation[None], statuses=np.array([Status.CONVERGED.value])
    )
    _, after = poses({1: body.properties}, [State("one", move)])
    there = body.surface.moved(after.matrices[0], after.positions[0]).vertices
    back = (there - PLACE - shift) @ rotation_matrix(rotation) + PLACE  # the truth taken back
    assert np.abs(solid.there(back)).max() < 0.4 * H
    half = np.array([1.5, 1.2, 1.0])
    corners = np.array(np.meshgrid(*[[-1, 1]] * 3)).reshape(3, -1).T * half  # all of it is there
    corners = rotation_matrix(rotation) @ TURN @ corners.T
    assert cKDTree(there).query(corners.T + PLACE + shift)[0].max() < 1.3 * H


def test_velocities_are_those_since_the_state_before():
    """Half a degree about z in 20 s, then back in 10 s; and a step where a time is missing."""
    turned = [0, 0, np.deg2rad(0.5)]
    states = [
        State("a", motions([0.1, 0, 0], turned, offset=(0, 0, 0)), 20.0),
        State("b", motions([0.1, 0.3, 0], [0, 0, 0], offset=(0, 0, 0)), 30.0),
        State("c", motions([0.1, 0.3, 0.5], [0, 0, 0], offset=(0, 0, 0))),
    ]
    _, a, b, c = poses(PROPERTIES, states)
    assert (a.per, b.per, c.per) == ("s", "s", "step")
    np.testing.assert_allclose(a.velocities[0], [0.005, 0, 0], atol=1e-12)
    np.testing.assert_allclose(a.angular_velocities[0], [0, 0, np.deg2rad(0.025)], atol=1e-12)
    np.testing.assert_allclose(b.velocities[0], [0, 0.03, 0], atol=1e-12)
    np.testing.assert_allclose(b.angular_velocities[0], [0, 0, -np.deg2rad(0.05)], atol=1e-12)
    np.testing.assert_allclose(c.velocities[0], [0, 0, 0.5], atol=1e-12)


def test_angular_velocity_is_in_the_sample_frame():
    """First a quarter turn about z, then a small one about x of the sample."""
    first = rotation_matrix([0, 0, np.pi / 2])
    second = rotation_matrix([0.01, 0, 0]) @ first
    from grainmotion.rotations import rotation_vector

    states = [
        State("a", motions([0, 0, 0], rotation_vector(first))),
        State("b", motions([0, 0, 0], rotation_vector(second))),
    ]
    np.testing.assert_allclose(poses(PROPERTIES, states)[2].angular_velocities[0], [0.01, 0, 0], atol=1e-9)


@pytest.mark.parametrize("status", [Status.ABSENT, Status.NOT_FITTED, Status.LEFT_FIELD])
def test_grains_without_a_motion_stay_listed_without_a_pose(status):
    states = [State("a", motions([0, 0, 0], [0, 0, 0], status=status)), State("b", motions([1, 0, 0], [0, 0, 0]))]
    _, a, b = poses(PROPERTIES, states)
    assert np.isnan(a.positions).all()
    assert np.isnan(a.quaternions).all()
    assert np.isnan(b.velocities).all()
    assert np.isfinite(b.positions).all()
    table = pose_table(poses(PROPERTIES, states))
    assert list(table["state"]) == ["reference", "a", "b"]
    assert list(table["status"]) == ["reference", status.value, "converged"]
    assert not table["ok_translation"][1]


def test_a_grain_that_the_state_does_not_name_has_no_pose():
    other = State("a", motions([1, 0, 0], [0, 0, 0], label=8))
    assert np.isnan(poses(PROPERTIES, [other])[1].positions).all()


def test_no_grains_and_nan_motions():
    assert len(pose_table(poses({}, [State("a", motions([0, 0, 0], [0, 0, 0]))]))) == 0
    broken = motions([np.nan] * 3, [np.nan] * 3, status=Status.BROKEN)
    _, a = poses(PROPERTIES, [State("a", broken)])
    assert np.isnan(a.positions).all()
    assert np.isnan(a.quaternions).all()
