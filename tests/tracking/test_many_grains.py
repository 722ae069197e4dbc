"""Many grains: the same motions as by the dense path, memory and work in proportion to their number."""

import tracemalloc

import numpy as np
import pytest

import many_small_grains as many
from grainmotion.objective.data_term import Target
from grainmotion.objective.normal_matrix import PatchNormalMatrix
from grainmotion.objective.residual import StateProblem
from grainmotion.projection.grain_arrays import GrainArrays
from grainmotion.rotations import rotation_vector
from grainmotion.solvers.gauss_newton import Stopping, gauss_newton


def problem_of(side, sigma=0.7):
    grains, views = many.block(side), many.views(side)
    scan, _ = many.state(grains, views)
    return StateProblem(GrainArrays.of(grains), Target(scan, np.zeros(scan.line_integrals.shape), "trilinear", sigma))


class TestPaths:
    def test_the_product_leads_where_the_dense_factor_leads(self, monkeypatch):
        """64 grains, 384 unknowns: the same motions to a millionth of a voxel, if steps are solved as exactly."""
        problem = problem_of(4)
        start, tight = many.still(64), Stopping(iterations=12, step=1e-9, decrease=0.0, forcing=1e-9)
        dense = gauss_newton(problem, start, tight).state
        monkeypatch.setattr("grainmotion.solvers.block_cg.MAX_DENSE_UNKNOWNS", 0)
        monkeypatch.setattr("grainmotion.objective.normal_matrix.MAX_DENSE_UNKNOWNS", 0)
        assert isinstance(problem.linearize(start).hessian, PatchNormalMatrix)
        product = gauss_newton(problem, start, tight).state
        apart = np.linalg.norm(dense.translations - product.translations, axis=1)
        turned = rotation_vector(dense.matrices @ product.matrices.transpose(0, 2, 1))
        apart += np.linalg.norm(turned, axis=1) * problem.grains.radii
        assert np.abs(dense.translations).max() > 0.3 * many.VOXEL  # it did move
        assert apart.max() < 1e-6 * many.VOXEL


class TestGrowth:
    @pytest.fixture(autouse=True)
    def products(self, monkeypatch):
        monkeypatch.setattr("grainmotion.solvers.block_cg.MAX_DENSE_UNKNOWNS", 0)
        monkeypatch.setattr("grainmotion.objective.normal_matrix.MAX_DENSE_UNKNOWNS", 0)

    @staticmethod
    def peak(side):
        """Bytes a grain that a linearisation and a step take at most."""
        problem = problem_of(side)
        pose = many.still(side**3)
        stopping = Stopping(iterations=1)
        gauss_newton(problem, pose, stopping)  # compiled, and the target's own images made
        tracemalloc.start()
        gauss_newton(problem, pose, stopping)
        found = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        return found / side**3

    def test_memory_a_grain_does_not_grow(self):
        """Blocks of overlapping grains would grow with the cube root of the number, a dense matrix with it."""
        few, more = self.peak(3), self.peak(7)
        assert more < 1.1 * few

    def test_patches_hold_the_derivatives_of_their_own_pixels_alone(self):
        seen = [problem_of(side).evaluate_with_derivatives(many.still(side**3)) for side in (3, 6)]
        few, more = (s.jacobian.derivatives.size / len(s.patches.seen) for s in seen)
        assert more == pytest.approx(few, rel=0.1)
