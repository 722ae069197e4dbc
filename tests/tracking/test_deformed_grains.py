"""Grains that no rigid motion explains (`tracking.deformed_grains`)."""

from dataclasses import replace

import numpy as np
import pytest

import few_grains
from classified_poses import classified, pose_of, problem_of
from grainmotion.model.motions import Status
from grainmotion.model.scan import Scan
from grainmotion.model.strain import stretches
from grainmotion.rotations import rotation_vector
from grainmotion.solvers.gauss_newton import gauss_newton
from grainmotion.solvers.stopping import Stopping
from grainmotion.tracking.deformed_grains import Deformations
from grainmotion.uncertainty.likely_strains import StrainStep

STILL = few_grains.motions(few_grains.grain_set(3, finer=1))  # the centres are those of all grains
STRAINS = np.zeros((3, 6))
STRAINS[1] = 0.04, -0.02, -0.02, 0.01, 0.0, -0.02


def tracked(strains, noise=0.01):
    """Motions and statuses at the best rigid motions of still grains that are strained."""
    problem = problem_of(few_grains.radiographs(few_grains.grain_set(3), STILL, noise=0), few_grains.grain_set(3))
    strained = replace(problem, grains=problem.grains.stretched(stretches(strains)))
    images = strained.evaluate(pose_of(STILL)).line_integrals
    images = images + noise * np.random.default_rng(3).standard_normal(images.shape)
    scan = Scan(images.astype(np.float32), few_grains.geometry())
    pose = gauss_newton(problem_of(scan, few_grains.grain_set(3)), pose_of(STILL), Stopping(20, 1e-4)).state
    return classified(scan, pose, few_grains.grain_set(3))


@pytest.fixture(scope="module")
def strained():
    return tracked(STRAINS)


def test_a_strained_grain_is_deformed_and_its_reason_names_the_strain(strained):
    assert strained.statuses.tolist() == [Status.CONVERGED, Status.DEFORMED, Status.CONVERGED]
    assert "[track] strain = true" in strained.reasons[1]
    size = float(strained.reasons[1].split("a strain of ")[1].split("%")[0])
    assert size == pytest.approx(100 * np.abs(np.linalg.eigvalsh(stretches(STRAINS[1]) - np.eye(3))).max(), rel=0.25)
    assert strained.ok_translation.all()
    np.testing.assert_array_equal(strained.ok_rotation, [True, False, True])


def test_its_standard_deviations_hold_the_error_that_the_strain_causes(strained):
    sd = np.sqrt(np.diagonal(strained.covariances, axis1=1, axis2=2))
    errors = np.hstack([strained.translations, rotation_vector(strained.matrices)])
    assert (np.abs(errors[1]) < 3 * sd[1]).all()
    rigid = np.sqrt(np.diagonal(tracked(0 * STRAINS).covariances, axis1=1, axis2=2))
    assert np.linalg.norm(sd[1, 3:]) > 3 * np.linalg.norm(rigid[1, 3:])


def test_rigid_grains_are_not_deformed():
    assert set(tracked(0 * STRAINS).statuses) == {Status.CONVERGED.value}


def test_a_strain_that_explains_little_or_is_small_only_enlarges_the_covariance():
    strains = np.zeros((4, 6))
    strains[:, 0] = 0.03, 0.03, 0.01, 0.03
    step = StrainStep(np.full((4, 6), 0.1), strains, np.array([0.9, 0.5, 0.9, 0.1]))
    found = Deformations.by_step(step, np.array([True, True, True, True]))
    np.testing.assert_array_equal(found.deformed, [True, False, False, False])
    np.testing.assert_allclose(found.covariances[:, 0, 0], [0.01, 0.01, 0.01, 0.0])
    assert not Deformations.by_step(step, np.zeros(4, dtype=bool)).deformed.any()


@pytest.mark.parametrize(("explained", "held"), [(0.16, True), (0.1, False)])
def test_a_small_share_that_most_grains_have_enlarges_the_covariances_of_these(explained, held):
    step = StrainStep(np.full((5, 6), 0.1), np.zeros((5, 6)), np.array([explained] * 4 + [0.02]))
    found = Deformations.by_step(step, np.ones(5, dtype=bool))
    np.testing.assert_allclose(found.covariances[:, 0, 0], [0.01 * held] * 4 + [0.0])
    assert not found.deformed.any()


@pytest.mark.parametrize(
    ("explained", "strain", "notes"), [(0.55, 0.03, 1), (0.3, 0.03, 0), (0.55, 0.01, 0), (0.9, 0.03, 0)]
)
def test_likely_strains_of_a_sample_are_noted_unless_its_grains_are_deformed(explained, strain, notes):
    strains = np.zeros((4, 6))
    strains[:, 0] = strain
    step = StrainStep(np.full((4, 6), 0.1), strains, np.full(4, explained))
    found = Deformations.by_step(step, np.ones(4, dtype=bool))
    assert len(found.notes) == notes
    if notes:
        assert "[track] strain = true" in found.notes[0]
