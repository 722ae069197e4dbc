"""Covariances (`uncertainty.covariance`), against the scatter of errors over many noise realisations."""

import numpy as np
import pytest

from classified_poses import LIMITS, classified, pose_of, problem_of, refined, shared_grains, shared_truth
from few_grains import ANGLES, geometry, grain_set, radiographs, small_motions
from grainmotion.model.scan import Scan
from grainmotion.objective.normal_matrix import normal_matrix, normal_of
from grainmotion.rotations import rotation_vector
from grainmotion.solvers.gauss_newton import gauss_newton
from grainmotion.solvers.stopping import Stopping
from grainmotion.tracking.classification import classify
from grainmotion.uncertainty.covariance import covariances, regular_inverse


class TestCovariance:
    def test_errors_over_thirty_noises_are_of_the_stated_size(self):
        """The root mean square of errors over stated standard deviations is one.

        The reference is exact here and the noise white: the covariance describes nothing but the noise.
        """
        grains = grain_set(3)
        truth = small_motions(grains)
        clean = radiographs(grains, truth, noise=0.0)
        ratios = []
        for seed in range(30):
            noise = 0.05 * np.random.default_rng(seed).standard_normal(clean.line_integrals.shape)
            problem = problem_of(Scan(clean.line_integrals + noise.astype(np.float32), clean.geometry), grains)
            solution = gauss_newton(problem, pose_of(truth), Stopping(10, 1e-4))
            measured = classify(grains, refined(problem, solution), np.zeros(3, dtype=bool), LIMITS, ())
            u = measured.translations - truth.translations
            w = rotation_vector(measured.matrices @ truth.matrices.transpose(0, 2, 1))
            ratios.append(np.hstack([u, w]) / np.sqrt(np.diagonal(measured.covariances, axis1=1, axis2=2)))
        rms = np.sqrt(np.mean(np.square(ratios), axis=(0, 1)))
        assert np.sqrt(np.mean(rms**2)) == pytest.approx(1, abs=0.2)
        assert rms.min() > 0.6
        assert rms.max() < 1.6

    def test_sd_grows_with_noise_and_falls_with_views_and_hardly_depends_on_the_filter(self):
        def sd(noise=0.02, angles=ANGLES, sigma=0.7):
            scan = radiographs(shared_grains(), shared_truth(), views=geometry(angles), noise=noise)
            measured = classified(scan, pose_of(shared_truth()), sigma=sigma)
            return np.sqrt(np.diagonal(measured.covariances, axis1=1, axis2=2))

        np.testing.assert_allclose(sd(noise=0.04), 2 * sd(noise=0.02), rtol=0.15)
        assert (sd(angles=(0.0, 30.0, 60.0, 90.0, 120.0, 150.0)) < sd(angles=(0.0, 90.0))).all()
        # a filter does not create information, and a mild one loses little
        assert (sd(sigma=0.7) > 0.85 * sd(sigma=0.0)).all()
        assert (sd(sigma=0.7) < 2 * sd(sigma=0.0)).all()

    def test_covariances_are_symmetric_and_positive_definite(self):
        matrices = classified(radiographs(shared_grains(), shared_truth()), pose_of(shared_truth())).covariances
        np.testing.assert_allclose(matrices, matrices.transpose(0, 2, 1), rtol=1e-6, atol=1e-12)
        assert (np.linalg.eigvalsh(matrices) > 0).all()

    def test_a_drift_of_gain_does_not_raise_the_residual(self):
        """A fitted gain is not counted as noise."""
        plain = classified(radiographs(shared_grains(), shared_truth()), pose_of(shared_truth()))
        drifted = classified(radiographs(shared_grains(), shared_truth(), gain=1.2), pose_of(shared_truth()))
        np.testing.assert_allclose(drifted.residuals, plain.residuals, rtol=0.02)
        assert drifted.fit.gain == pytest.approx(1.2, abs=2e-3)

    def test_sampled_covariances_are_close_to_the_inverse(self, monkeypatch):
        """For many grains covariances are sampled; standard deviations have a relative error of √(1 / (2 draws))."""
        problem = problem_of(radiographs(shared_grains(), shared_truth()))
        pose = pose_of(shared_truth())
        evaluation = problem.evaluate_with_derivatives(pose)
        dense, _ = covariances(problem, pose, evaluation, normal_matrix(evaluation.jacobian))
        monkeypatch.setattr("grainmotion.objective.normal_matrix.MAX_DENSE_UNKNOWNS", 0)
        monkeypatch.setattr("grainmotion.solvers.block_cg.MAX_DENSE_UNKNOWNS", 0)
        monkeypatch.setattr("grainmotion.uncertainty.noise_draws.NOISE_DRAWS", 200)
        product = normal_of(evaluation.jacobian)
        sampled, _ = covariances(problem, pose, evaluation, product)
        np.testing.assert_allclose(
            np.sqrt(np.diagonal(sampled, axis1=1, axis2=2)), np.sqrt(np.diagonal(dense, axis1=1, axis2=2)), rtol=0.15
        )
        assert (np.linalg.eigvalsh(sampled) > 0).all()


class TestRegularInverse:
    def test_undetermined_directions_get_a_huge_variance_and_affect_no_other(self):
        matrix = np.diag([4.0, 1.0, 0.0, 9.0])
        inverse, undetermined = regular_inverse(matrix)
        np.testing.assert_allclose(np.diagonal(inverse)[[0, 1, 3]], [1 / 4, 1, 1 / 9])
        assert inverse[2, 2] > 1e9
        np.testing.assert_allclose(np.diagonal(undetermined)[[0, 1, 3]], 0)
        assert undetermined[2, 2] == inverse[2, 2]
