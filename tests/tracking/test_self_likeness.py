"""Near-symmetries of grains (`tracking.self_likeness`): those of solids with known groups, none of gravel and balls."""

import numpy as np
import pytest
from tests.symmetric_grains import SHAPES, case

from grainmotion.model.volume import Volume
from grainmotion.projection.grain_arrays import GrainArrays
from grainmotion.rotations import rotation_matrix
from grainmotion.segmentation.extraction import grains_from_labels
from grainmotion.tracking.self_likeness import angles_between, near_symmetries

# Rotations other than the identity, and mirrored ones, of each solid's group.
ORDERS = {
    "cube": (23, 24), "cuboid": (3, 4), "hexagonal prism": (11, 12), "triangular prism": (5, 6),
    "tetrahedron": (11, 12), "ellipsoid": (3, 4), "ball": (0, 0),
}  # fmt: skip


def found(name, seed=0):
    return near_symmetries(GrainArrays.of(case(name, seed=seed).grains), 0)


@pytest.mark.parametrize("name", ORDERS)
@pytest.mark.parametrize("seed", [0, 1])
def test_number_of_symmetries_is_that_of_the_group(name, seed):
    signs = np.linalg.det(found(name, seed).matrices)
    assert (int((signs > 0).sum()), int((signs < 0).sum())) == ORDERS[name]


@pytest.mark.parametrize("name", ["cube", "hexagonal prism", "tetrahedron"])
def test_symmetries_carry_corners_to_corners(name):
    corners = case(name).sample.particles[0].shape
    points = corners.vertices - corners.centroid
    size = np.linalg.norm(points, axis=1).max()
    for matrix in found(name).matrices:
        distances = np.linalg.norm((points @ matrix.T)[:, None] - points, axis=2).min(axis=1)
        assert distances.max() < 0.05 * size  # 3 degrees


def test_likeness_of_symmetries_is_nearly_one():
    assert found("cube").likeness.min() > 0.97


@pytest.mark.parametrize("stone", [3, 17, 29, 42, 58, 71, 90])
def test_gravel_has_none(stone):
    assert len(found(f"stone {stone}").matrices) == 0


def nearly_round(longer, noise, seed=0):
    """An ellipsoid of 20 voxels whose axes are 1, 1 + longer / 2 and 1 + longer, with noisy voxels."""
    axes = 10 * np.array([1 + longer, 1 + longer / 2, 1])
    places = np.stack(np.meshgrid(*[np.arange(-15, 16)] * 3, indexing="ij")) / axes[:, None, None, None]
    inside = np.clip(0.5 + 10 * (1 - np.linalg.norm(places, axis=0)), 0, 1)
    image = inside * (1 + noise * np.random.default_rng(seed).standard_normal(inside.shape))
    return GrainArrays.of(grains_from_labels(Volume(0.1 * image, 0.125), (inside > 0.5).astype(np.int32), reach=0))


@pytest.mark.parametrize("seed", range(4))
def test_noise_hides_no_symmetry_of_a_nearly_round_grain(seed):
    signs = np.linalg.det(near_symmetries(nearly_round(0.1, 0.08, seed), 0).matrices)
    assert (int((signs > 0).sum()), int((signs < 0).sum())) == ORDERS["ellipsoid"]


def test_angles_between_rotations():
    one = rotation_matrix([0.3, -0.2, 0.5])
    for angle in (0.0, 0.1, 2.0, np.pi):
        assert angles_between(one @ rotation_matrix([0, 0, angle]), one) == pytest.approx(angle, abs=1e-7)


def test_every_shape_is_tried():
    assert set(SHAPES) - {"chipped cube"} == set(ORDERS)
