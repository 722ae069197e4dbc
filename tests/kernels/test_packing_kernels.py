"""Packing kernels: rotation matrices, and bodies that fall onto the floor and onto each other."""

import numpy as np
import pytest

from grainmotion.kernels import packing
from grainmotion.rotations import rotation_matrix
from grainmotion.simulate import sphere
from grainmotion.simulate.packing_arrays import Poses, Rules, stack
from grainmotion.simulate.signed_distance import locator

RULES = Rules(radius=5.0, gap=1e-3, size=2.0)


@pytest.mark.parametrize("vector", [(0.0, 0.0, 0.0), (0.3, -1.0, 0.4), (0.0, 3.0, 0.0)])
def test_rotation_matrices_are_those_of_the_package(vector):
    np.testing.assert_allclose(packing.rotation_of(np.array(vector)), rotation_matrix(vector), atol=1e-14)


def test_ball_falls_to_the_floor_and_another_onto_it():
    balls = stack([locator(sphere(2.0))[0], locator(sphere(2.0))[0]])
    poses = Poses(np.array([[0.0, 0.0, 8.0], [0.0, 0.0, 8.0]]), np.tile(np.eye(3), (2, 1, 1)))
    heights = []
    for i in range(2):
        poses.positions[i, 2] = packing.fall(i, i, poses.positions[i], poses.rotations[i], poses, balls, RULES)
        heights.append(poses.positions[i, 2])
    assert heights == pytest.approx([1.0, 3.0], abs=5e-3)
    gaps = np.full((2, 2), np.inf)
    packing.all_gaps(poses, balls, 0.1, gaps)
    assert RULES.gap <= min(gaps[0, 1], gaps[1, 0]) < 5e-3
