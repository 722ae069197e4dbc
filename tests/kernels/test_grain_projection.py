"""Projection of grains patch by patch: values, derivatives and the sum of patches."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

import few_grains
from grainmotion.kernels import grain_projection
from grainmotion.kernels.layout import ViewTable
from grainmotion.model.pose import Pose
from grainmotion.projection.footprints import footprint_patches
from grainmotion.projection.grain_arrays import GrainArrays
from grainmotion.rotations import rotation_matrix
from patch_tables import BOXES, DERIVATIVES, SHAPE, TABLE

PACKED = GrainArrays.of(few_grains.smooth_grains())
GRAINS = replace(PACKED, images=PACKED.images.astype(float))
GEOMETRY = few_grains.geometry([10.0, 75.0])
VIEWS = ViewTable(GEOMETRY.vectors, True, np.array(GEOMETRY.shape))
POSE = Pose(np.array([[0.03, -0.02, 0.01], [0.0, 0.05, -0.04]]), rotation_matrix([[0.1, 0.2, -0.1], [0.0, -0.2, 0.3]]))


@cache
def patches():
    return footprint_patches(GRAINS, POSE, GEOMETRY, margin=1)


def values_at(pose, exact=False):
    values = np.full(patches().offsets[-1], 7.0)
    grain_projection.project(GRAINS.table(pose), VIEWS, patches().table, exact, values)
    return values


@pytest.mark.parametrize("exact", [False, True], ids=["trilinear", "exact"])
def test_both_kernels_have_the_same_values(exact):
    values = np.full(patches().offsets[-1], 7.0)
    derivatives = np.full((6, len(values)), 7.0)
    grain_projection.project_with_derivatives(GRAINS.table(POSE), VIEWS, patches().table, exact, values, derivatives)
    np.testing.assert_allclose(values_at(POSE, exact), values, atol=1e-12)
    untouched = values == 7.0  # the margin: pixels of no run
    assert untouched.any()
    assert (derivatives[:, untouched] == 7.0).all()
    assert (derivatives[:, ~untouched] != 7.0).all()


def test_derivatives_are_the_limits_of_differences():
    """Steps are so short that no ray passes a voxel's corner, where the trilinear image has a kink."""
    values, derivatives = np.zeros(patches().offsets[-1]), np.zeros((6, patches().offsets[-1]))
    grain_projection.project_with_derivatives(GRAINS.table(POSE), VIEWS, patches().table, False, values, derivatives)
    step = 1e-7
    for k in range(6):
        ends = []
        for sign in (-1, 1):
            increment = sign * step * np.eye(6)[k]
            ends.append(
                values_at(Pose(POSE.translations + increment[:3], rotation_matrix(increment[3:]) @ POSE.matrices))
            )
        differences = (ends[1] - ends[0]) / (2 * step)
        np.testing.assert_allclose(differences, derivatives[k], atol=1e-6 * np.abs(derivatives[k]).max())


def test_patches_that_overlap_are_added():
    expected = np.zeros(SHAPE)
    for (_, view, r0, r1, c0, c1), start, end in zip(BOXES, TABLE.offsets[:-1], TABLE.offsets[1:], strict=True):
        expected[view, r0:r1, c0:c1] += DERIVATIVES[0, start:end].reshape(r1 - r0, c1 - c0)
    out = np.zeros(SHAPE)
    grain_projection.add_patches(DERIVATIVES[0], BOXES, TABLE.offsets, out)
    np.testing.assert_allclose(out, expected, atol=1e-15)
