"""Displacement bases (`objective.displacement_bases`): the motions they represent."""

from types import SimpleNamespace

import numpy as np
import pytest

from grainmotion.model.pose import Pose
from grainmotion.objective import displacement_bases
from grainmotion.rotations import rotation_matrix

BASES = {
    "rigid": (displacement_bases.rigid, 6),
    "affine": (displacement_bases.affine, 12),
    "quadratic": (displacement_bases.quadratic, 30),
}


class GrainCenters(SimpleNamespace):
    """The attributes of grains that a basis uses."""

    def __len__(self):
        return len(self.centers)


def scattered(n=25, seed=0):
    """Grains at random positions with random poses, in a box that is longer along z."""
    rng = np.random.default_rng(seed)
    grains = GrainCenters(centers=rng.uniform(-1, 1, (n, 3)) * [2, 3, 6] + [4, 5, 6], voxel_size=0.1)
    return grains, Pose(rng.normal(size=(n, 3)) * 0.3, rotation_matrix(rng.normal(size=(n, 3))))


def moved_centers(grains, pose):
    x = grains.centers + pose.translations
    return x, x - x.mean(axis=0)


def fitted(basis, grains, pose, increments):
    """The increments (n, 6) of the basis that are closest to the given ones."""
    tie = basis(grains, pose)
    return (tie @ np.linalg.lstsq(tie, increments.ravel(), rcond=None)[0]).reshape(-1, 6)


@pytest.mark.parametrize("name", BASES)
class TestEveryBasis:
    def test_size_and_rank(self, name):
        basis, m = BASES[name]
        tie = basis(*scattered())
        assert tie.shape == (150, m)
        assert np.linalg.matrix_rank(tie) == m
        # parameters have one scale, so that damping treats them equally
        norms = np.linalg.norm(tie[:, :3], axis=0)
        assert norms.max() < 1e3

    def test_represents_translations_of_the_sample(self, name):
        grains, pose = scattered()
        shift = np.tile([0.1, -0.2, 0.3, 0, 0, 0], (25, 1))
        np.testing.assert_allclose(fitted(BASES[name][0], grains, pose, shift), shift, atol=1e-10)

    def test_represents_rotations_of_the_sample(self, name):
        """A small rotation of the sample moves the centres and rotates every grain by the same vector."""
        grains, pose = scattered()
        w = np.array([0.3, -0.2, 0.5])
        x, centered = moved_centers(grains, pose)
        rotation = np.concatenate([np.cross(w, centered), np.tile(w, (25, 1))], axis=1)
        np.testing.assert_allclose(fitted(BASES[name][0], grains, pose, rotation), rotation, atol=1e-10)
        # and about any other point
        about = np.concatenate([np.cross(w, x), np.tile(w, (25, 1))], axis=1)
        np.testing.assert_allclose(fitted(BASES[name][0], grains, pose, about), about, atol=1e-9)

    def test_basis_of_one_grain_is_finite(self, name):
        grains, pose = scattered(1)
        assert np.isfinite(BASES[name][0](grains, pose)).all()


class TestAffine:
    def test_represents_any_gradient_with_rotations_of_its_skew_part(self):
        grains, pose = scattered()
        A = np.random.default_rng(1).normal(size=(3, 3))
        _, x = moved_centers(grains, pose)
        skew = (A - A.T) / 2
        w = np.array([skew[2, 1], skew[0, 2], skew[1, 0]])
        strain = np.concatenate([x @ A.T, np.tile(w, (25, 1))], axis=1)
        for basis in (displacement_bases.affine, displacement_bases.quadratic):
            np.testing.assert_allclose(fitted(basis, grains, pose, strain), strain, atol=1e-9)

    def test_rigid_basis_represents_no_strain(self):
        grains, pose = scattered()
        _, x = moved_centers(grains, pose)
        stretch = np.concatenate([x * [1, 0, 0], np.zeros((25, 3))], axis=1)
        assert np.abs(fitted(displacement_bases.rigid, grains, pose, stretch) - stretch).max() > 0.5


class TestQuadratic:
    def test_represents_any_quadratic_field_with_rotations_of_half_its_curl(self):
        """The rotations are half the curl of the displacements, taken by finite differences here."""
        grains, pose = scattered()
        rng = np.random.default_rng(2)
        a, A, Q = rng.normal(size=3), rng.normal(size=(3, 3)), 0.1 * rng.normal(size=(3, 3, 3))
        _, x = moved_centers(grains, pose)

        def field(p):
            return a + p @ A.T + np.einsum("kij,ni,nj->nk", Q, p, p)

        step = 1e-5
        gradient = np.stack(
            [(field(x + step * e) - field(x - step * e)) / (2 * step) for e in np.eye(3)], axis=2
        )  # n, component, direction
        curl = np.stack(
            [gradient[:, (k + 2) % 3, (k + 1) % 3] - gradient[:, (k + 1) % 3, (k + 2) % 3] for k in range(3)], 1
        )
        increments = np.concatenate([field(x), curl / 2], axis=1)
        np.testing.assert_allclose(
            fitted(displacement_bases.quadratic, grains, pose, increments), increments, atol=1e-8
        )
        assert np.abs(fitted(displacement_bases.affine, grains, pose, increments) - increments).max() > 0.05
