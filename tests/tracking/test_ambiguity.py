"""Discrete ambiguity (`tracking.ambiguity`): grains that look alike in several poses, and grains that do not."""

import re
from dataclasses import replace

import numpy as np
import pytest
from tests.symmetric_grains import case, cone

from grainmotion.model.geometry import Geometry
from grainmotion.model.motions import Status
from grainmotion.rotations import rotation_matrix, rotation_vector
from grainmotion.tracking.self_likeness import angles_between
from grainmotion.tracking.settings import TrackSettings
from grainmotion.tracking.track import track

FOUR, TWO = (0.0, 45.0, 90.0, 135.0), (22.5, 112.5)
QUICK = TrackSettings(search=False)


def errors_and_excess(some, truth, measured):
    """Degrees from the nearest equivalent pose, and by which the pose found is further from the start than need be."""
    out = []
    for row, matrix in enumerate(measured.matrices):
        poses = some.equivalent_poses(row, truth.matrices[row])
        errors, sizes = angles_between(poses, matrix), angles_between(poses, np.eye(3))
        out.append((errors.min(), sizes[np.argmin(errors)] - sizes.min()))
    return np.rad2deg(np.array(out)).T


class TestSymmetricGrains:
    @pytest.mark.parametrize(
        ("name", "angle", "views", "named"),
        [
            ("cube", 0, FOUR, "90 degrees about ("), ("cube", 5, TWO, "90 degrees about ("),
            ("cube", 50, FOUR, "90 degrees about ("), ("cube", 85, FOUR, "90 degrees about ("),
            ("cube", 120, FOUR, "90 degrees about ("), ("ellipsoid", 5, TWO, "degrees about ("),
            ("ellipsoid", 50, FOUR, "180 degrees about ("), ("cuboid", 50, TWO, "180 degrees about ("),
            ("hexagonal prism", 85, FOUR, "60 degrees about ("), ("hexagonal prism", 5, FOUR, "60 degrees about ("),
            ("tetrahedron", 50, FOUR, "120 degrees about ("),
        ],
    )  # fmt: skip
    def test_are_ambiguous_in_the_equivalent_pose_nearest_to_the_start(self, name, angle, views, named):
        some = case(*[name] * 5)
        truth = some.rotated(angle * np.array([0.6, -0.48, 0.64]))
        measured = track(some.grains, some.state(truth, cone(views)), settings=QUICK)
        assert set(measured.statuses) == {Status.AMBIGUOUS.value}
        assert sum(named in reason for reason in measured.reasons) >= 4
        assert not measured.ok.any()
        errors, excess = errors_and_excess(some, truth, measured)
        assert errors.max() < 3
        assert excess.max() < 12  # two nearly as near: either is right
        assert np.abs(measured.translations - truth.translations).max() < 0.2 * 0.125

    def test_a_sample_that_rotates_as_one_body_is_followed(self):
        """Rotated by 60 degrees about z, cubes come out so, not as −30 degrees, if the fit starts near."""
        some = case(*["cube"] * 5)
        truth = some.rotated([0, 0, 60])
        start = some.rotated([0, 0, 55])
        measured = track(some.grains, some.state(truth, cone(FOUR)), start, QUICK)
        np.testing.assert_allclose(measured.rotations, truth.rotations, atol=np.deg2rad(2))


class TestMirroredPoses:
    """Cubes along the axes, rotated by ±8 degrees about z, look alike in parallel beams at 0, 45 and 90 degrees."""

    def measured(self, angles, start_deg):
        some = case(*["cube"] * 2, aligned=True)
        truth = some.rotated([0, 0, 8])
        views = Geometry.parallel(angles, (64, 64), 0.125)
        start = replace(truth, rotations=np.deg2rad(np.tile([0, 0, start_deg], (2, 1))))
        return track(some.grains, some.state(truth, views), start, replace(QUICK, fields=False, filters=(2.0, 0.7)))

    @pytest.mark.parametrize("start", [6.0, -6.0])
    def test_views_that_do_not_tell_them_apart_name_the_mirrored_one(self, start):
        measured = self.measured((0.0, 45.0, 90.0), start)
        assert set(measured.statuses) == {Status.AMBIGUOUS.value}
        np.testing.assert_allclose(np.rad2deg(measured.rotations), [[0, 0, np.sign(start) * 8]] * 2, atol=2)
        assert all(re.search(r"by 1[4-8] degrees about \(.*, ", reason) for reason in measured.reasons)

    def test_the_right_one_is_found_from_the_wrong_one_where_views_tell_them_apart(self):
        measured = self.measured((10.0, 40.0, 100.0), -6.0)
        np.testing.assert_allclose(np.rad2deg(measured.rotations), [[0, 0, 8]] * 2, atol=2)


class TestUniqueGrains:
    @pytest.mark.parametrize("views", [FOUR, TWO])
    @pytest.mark.parametrize(
        "names", [["chipped cube"] * 5, ["stone 3", "stone 29", "stone 42", "stone 71", "stone 90"]]
    )
    def test_stay_converged(self, names, views):
        some = case(*names)
        truth = some.rotated([4, -5, 6])
        measured = track(some.grains, some.state(truth, cone(views)), settings=QUICK)
        assert set(measured.statuses) == {Status.CONVERGED.value}, measured.reasons
        np.testing.assert_allclose(measured.rotations, truth.rotations, atol=np.deg2rad(1.5))

    def test_balls_stay_poorly_determined(self):
        some = case(*["ball"] * 5)
        measured = track(some.grains, some.state(some.rotated([4, -5, 6]), cone(FOUR)), settings=QUICK)
        assert set(measured.statuses) == {Status.POORLY_DETERMINED.value}

    def test_nothing_is_tried_if_the_settings_say_so(self):
        some = case(*["cube"] * 5)
        truth = some.rotated([1, 2, 3])
        quick = replace(QUICK, alternatives=False)
        measured = track(some.grains, some.state(truth, cone(FOUR)), settings=quick)
        assert set(measured.statuses) == {Status.CONVERGED.value}


def test_names_are_rotations_from_the_pose_found():
    from grainmotion.tracking.ambiguity import _reason

    here = rotation_matrix([0.1, 0.2, 0.3])
    there = [rotation_matrix([0, 0, np.pi / 2]) @ here, rotation_matrix([0, -np.pi, 0]) @ here]
    reason = _reason(np.array(there), here)
    assert "90 degrees about (0, 0, 1), or 180 degrees about (0, 1, 0)" in reason
    assert rotation_vector(there[0] @ here.T)[2] > 0
