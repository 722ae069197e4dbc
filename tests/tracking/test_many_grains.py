"""Tracking many grains: the same motions as with dense matrices, and memory in proportion to their number."""

import tracemalloc

import numpy as np
import pytest

import many_small_grains as many
from grainmotion.objective.data_term import Target
from grainmotion.objective.normal_matrix import PatchNormalMatrix
from grainmotion.objective.residual import StateProblem
from grainmotion.projection.grain_arrays import GrainArrays
from grainmotion.rotations import rotation_vector
from grainmotion.solvers.gauss_newton import gauss_newton
from grainmotion.solvers.stopping import Stopping


def problem_of(side, sigma=0.7):
    grains, views = many.block(side), many.views(side)
    scan, _ = many.state(grains, views)
    return StateProblem(GrainArrays.of(grains), Target(scan, np.zeros(scan.line_integrals.shape), "trilinear", sigma))


class TestMatrixFree:
    def test_matrix_free_motions_equal_dense_ones(self, monkeypatch):
        """64 grains, 384 unknowns: the same motions to a millionth of a voxel, if steps are solved to high accuracy."""
        problem = problem_of(4)
        start, tight = many.still(64), Stopping(iterations=12, step=1e-9, decrease=0.0, forcing=1e-9)
        dense = gauss_newton(problem, start, tight).state
        monkeypatch.setattr("grainmotion.solvers.block_cg.MAX_DENSE_UNKNOWNS", 0)
        monkeypatch.setattr("grainmotion.objective.normal_matrix.MAX_DENSE_UNKNOWNS", 0)
        assert isinstance(problem.linearize(start).hessian, PatchNormalMatrix)
        matrix_free = gauss_newton(problem, start, tight).state
        difference = np.linalg.norm(dense.translations - matrix_free.translations, axis=1)
        rotation_difference = rotation_vector(dense.matrices @ matrix_free.matrices.transpose(0, 2, 1))
        difference += np.linalg.norm(rotation_difference, axis=1) * problem.grains.radii
        assert np.abs(dense.translations).max() > 0.3 * many.VOXEL  # the grains did move
        assert difference.max() < 1e-6 * many.VOXEL


class TestMemory:
    @pytest.fixture(autouse=True)
    def matrix_free(self, monkeypatch):
        monkeypatch.setattr("grainmotion.solvers.block_cg.MAX_DENSE_UNKNOWNS", 0)
        monkeypatch.setattr("grainmotion.objective.normal_matrix.MAX_DENSE_UNKNOWNS", 0)

    @staticmethod
    def peak(side):
        """Peak memory of a linearisation and a step, bytes per grain."""
        problem = problem_of(side)
        pose = many.still(side**3)
        stopping = Stopping(iterations=1)
        gauss_newton(problem, pose, stopping)  # compiles kernels and makes the target's images
        tracemalloc.start()
        gauss_newton(problem, pose, stopping)
        peak_bytes = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        return peak_bytes / side**3

    def test_memory_per_grain_does_not_grow(self):
        """Blocks of overlapping grains would grow with the cube root of their number, a dense matrix linearly."""
        few, many_more = self.peak(3), self.peak(7)
        assert many_more < 1.1 * few

    def test_number_of_derivatives_per_patch_does_not_grow(self):
        evaluations = [problem_of(side).evaluate_with_derivatives(many.still(side**3)) for side in (3, 6)]
        few, more = (s.jacobian.derivatives.size / len(s.patches.seen) for s in evaluations)
        assert more == pytest.approx(few, rel=0.1)
