"""Which strain a solution of rigid motions makes likely."""

from dataclasses import replace

import numpy as np

import few_grains
from classified_poses import pose_of, problem_of
from grainmotion.model.scan import Scan
from grainmotion.model.strain import stretches
from grainmotion.solvers.gauss_newton import gauss_newton
from grainmotion.solvers.stopping import Stopping
from grainmotion.uncertainty.likely_strains import strain_step

STRAINS = np.zeros((3, 6))
STRAINS[1] = 0.04, -0.02, -0.02, 0.01, 0.0, -0.02


def step_of(strains, noise, seed=0):
    """The test at the best rigid motions of grains with given strains, in images of the package's own projector."""
    still = few_grains.motions(few_grains.grain_set(3))
    problem = problem_of(few_grains.radiographs(few_grains.grain_set(3), still, noise=0), few_grains.grain_set(3))
    strained = replace(problem, grains=problem.grains.stretched(stretches(strains)))
    images = strained.evaluate(pose_of(still)).line_integrals
    images = images + noise * np.random.default_rng(seed).standard_normal(images.shape)
    problem = problem_of(Scan(images.astype(np.float32), few_grains.geometry()), few_grains.grain_set(3))
    return strain_step(problem, gauss_newton(problem, pose_of(still), Stopping(20, 1e-4)).state)


def test_a_strained_grain_is_found_among_rigid_ones():
    step = step_of(STRAINS, noise=0.005)
    assert step.explained[1] > 0.8
    assert step.principal[[0, 2]].max() < 0.2 * step.principal[1]  # what they show of it in their shadows is not theirs
    np.testing.assert_allclose(step.strains[1], STRAINS[1], atol=0.012)


def test_strains_explain_little_of_rigid_grains():
    step = step_of(0 * STRAINS, noise=0.02)
    assert np.abs(step.explained).max() < 0.1
    assert step.principal.max() < 0.02
