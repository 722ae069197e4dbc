"""Pose from given start motions (`tracking.initial_guess`)."""

from dataclasses import replace

import numpy as np

from few_grains import (
    grain_set,
    motions,
)
from grainmotion.model.grains import GrainSet
from grainmotion.model.motions import Motions
from grainmotion.model.starting_pose import starting_pose
from grainmotion.rotations import apply_motion

GRAINS = grain_set(finer=1)


class TestStartingPose:
    def test_rows_are_matched_by_label(self):
        start = motions(grain_set(), np.arange(15).reshape(5, 3))
        order = [3, 0, 4, 1, 2]
        mixed = Motions.from_table(start.to_table().iloc[order])
        pose = starting_pose(GrainSet((GRAINS.grains[4], GRAINS.grains[1])), mixed)
        np.testing.assert_allclose(pose.translations, start.translations[[4, 1]])

    def test_grains_without_a_start_get_that_of_the_others(self):
        start = motions(GRAINS, (0.3, 0.1, -0.2), (0, 0, 10))
        start.translations[2] = start.rotations[2] = np.nan
        pose = starting_pose(GRAINS, start)
        np.testing.assert_allclose(pose.translations[2], (0.3, 0.1, -0.2))
        np.testing.assert_allclose(pose.matrices[2], np.eye(3))
        assert np.isfinite(pose.matrices).all()

    def test_a_start_of_nan_is_no_motion(self):
        start = motions(GRAINS, np.nan, np.nan)
        pose = starting_pose(GRAINS, start)
        np.testing.assert_array_equal(pose.translations, 0)

    def test_a_start_about_other_centres_is_the_same_motion(self):
        """A start about centres of another segmentation moves every point of the grain to the same position."""
        start = replace(motions(GRAINS, 0.2, 30.0), centers=GRAINS.centers + 0.3)
        pose = starting_pose(GRAINS, start)
        points = GRAINS.centers + 0.5
        moved = apply_motion(pose.matrices, pose.translations, GRAINS.centers, points)
        expected = apply_motion(start.matrices, start.translations, start.centers, points)
        np.testing.assert_allclose(moved, expected)
