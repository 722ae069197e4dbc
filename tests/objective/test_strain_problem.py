"""The residual with twelve unknowns a grain: its gradient and normal matrix, and its steps."""

from dataclasses import replace

import numpy as np
import pytest

import few_grains
from grainmotion.model.pose import Pose
from grainmotion.model.strain import tensors
from grainmotion.objective.data_term import Target
from grainmotion.objective.strain_problem import MAX_PRINCIPAL_STRAIN, StrainedPose, StrainProblem, with_strains
from grainmotion.projection.grain_arrays import GrainArrays
from grainmotion.rotations import rotation_matrix
from grainmotion.solvers.gauss_newton import gauss_newton
from grainmotion.solvers.stopping import Stopping

GRAINS = GrainArrays.of(few_grains.smooth_grains())
GRAINS = replace(GRAINS, images=GRAINS.images.astype(float))
GEOMETRY = few_grains.geometry()
STRAINS = np.array([[0.05, -0.03, 0.01, 0.02, -0.02, 0.03], [0.0, 0.04, -0.05, 0.0, 0.01, -0.03]])
TRUTH = StrainedPose(
    Pose(
        np.array([[0.03, -0.02, 0.01], [0.0, 0.05, -0.04]]), rotation_matrix([[0.03, 0.02, -0.1], [0.0, -0.02, 0.05]])
    ),
    STRAINS,
)
START = StrainedPose(Pose(np.zeros((2, 3)), np.tile(np.eye(3), (2, 1, 1))), np.zeros((2, 6)))


def problem(sigma=1.0, strain_sd=0.1):
    nothing = few_grains.radiographs(
        few_grains.smooth_grains(), few_grains.motions(few_grains.smooth_grains()), noise=0
    )
    empty = np.zeros(nothing.line_integrals.shape)
    blank = Target(replace(nothing, line_integrals=empty), empty, "trilinear", sigma)
    images = StrainProblem(GRAINS, blank, strain_sd).at(STRAINS).evaluate(TRUTH.pose).line_integrals
    return StrainProblem(GRAINS, replace(blank, scan=replace(nothing, line_integrals=images)), strain_sd)


def test_gradient_is_the_limit_of_differences():
    posed, at = problem(), StrainedPose(TRUTH.pose, 0.5 * STRAINS)
    gradient, step = posed.linearize(at).gradient, 1e-6
    for k in (0, 4, 11, 12, 14, 15, 22, 23):
        ends = [posed.cost(posed.retract(at, sign * step * np.eye(24)[k])) for sign in (1, -1)]
        assert (ends[0] - ends[1]) / (2 * step) == pytest.approx(
            gradient[k], rel=2e-3, abs=1e-4 * np.abs(gradient).max()
        )


def test_normal_matrix_is_the_square_of_the_jacobian():
    posed = problem(strain_sd=1e6)
    jacobian = with_strains(posed.at(STRAINS), TRUTH.pose).jacobian
    columns = np.stack(jacobian.images(np.eye(24).reshape(24, 4, 6))).reshape(24, -1)
    expected = columns @ columns.T
    scale = np.sqrt(np.diagonal(expected))
    found = posed.linearize(TRUTH).hessian.toarray()
    np.testing.assert_allclose(found / np.outer(scale, scale), expected / np.outer(scale, scale), atol=1e-9)


def test_strains_of_the_same_model_are_found():
    end = gauss_newton(problem(strain_sd=10.0), START, Stopping(30, 1e-6, 1e-14)).state
    np.testing.assert_allclose(end.strains, STRAINS, atol=1e-4)
    np.testing.assert_allclose(end.pose.translations, TRUTH.pose.translations, atol=1e-5)


def test_a_narrow_prior_keeps_strains_at_zero():
    end = gauss_newton(problem(strain_sd=1e-6), START, Stopping(10)).state
    assert np.abs(end.strains).max() < 1e-4


def test_no_step_makes_a_stretch_singular():
    posed, state = problem(), START
    for _ in range(20):
        state = posed.retract(state, np.full(24, 5.0))
    assert np.abs(np.linalg.eigvalsh(tensors(state.strains))).max() <= MAX_PRINCIPAL_STRAIN + 1e-12
