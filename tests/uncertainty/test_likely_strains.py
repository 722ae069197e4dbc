"""Which strain a solution of rigid motions makes likely."""

from dataclasses import replace

import numpy as np

import few_grains
from classified_poses import pose_of, problem_of
from grainmotion.model.scan import Scan
from grainmotion.model.strain import stretches
from grainmotion.solvers.gauss_newton import Stopping, gauss_newton
from grainmotion.uncertainty.likely_strains import likely_strains

GRAINS = few_grains.grain_set(3)
STRAINS = np.zeros((3, 6))
STRAINS[1] = 0.04, -0.02, -0.02, 0.01, 0.0, -0.02


def likely_of(strains, noise, seed=0):
    """The test at the best rigid motions of grains with given strains, in images of the package's own projector."""
    still = few_grains.motions(GRAINS)
    problem = problem_of(few_grains.radiographs(GRAINS, still, noise=0), GRAINS)
    strained = replace(problem, grains=problem.grains.stretched(stretches(strains)))
    images = strained.evaluate(pose_of(still)).line_integrals
    images = images + noise * np.random.default_rng(seed).standard_normal(images.shape)
    problem = problem_of(Scan(images.astype(np.float32), few_grains.geometry()), GRAINS)
    return likely_strains(problem, gauss_newton(problem, pose_of(still), Stopping(20, 1e-4)).state)


def test_a_strained_grain_is_found_among_rigid_ones():
    likely = likely_of(STRAINS, noise=0.02)
    assert likely.chi2[1] > 20 * likely.chi2[[0, 2]].max()
    np.testing.assert_allclose(likely.strains[1], STRAINS[1], atol=0.012)


def test_rigid_grains_have_no_strain_beyond_its_standard_deviation():
    """χ² of six strains is 6 in the mean, and its standard deviation over twelve grains is 1."""
    chi2 = np.concatenate([likely_of(0 * STRAINS, noise=0.02, seed=seed).chi2 for seed in range(4)])
    assert 3 < chi2.mean() < 9
    assert chi2.max() < 25
