"""Statuses, sentences and covariances: what is said of each grain is true."""

from dataclasses import replace

import numpy as np
import pytest

from few_grains import ANGLES, GAIN_AND_OFFSET, PANEL, VOXEL, geometry, grain_set, motions, radiographs, small_motions
from grainmotion.model.geometry import Geometry
from grainmotion.model.motions import Status
from grainmotion.model.pose import Pose
from grainmotion.model.scan import Scan
from grainmotion.objective.data_term import Target
from grainmotion.objective.normal_matrix import normal_matrix, normal_of
from grainmotion.objective.residual import StateProblem
from grainmotion.objective.response_parameters import ResponseModel
from grainmotion.projection.grain_arrays import GrainArrays
from grainmotion.rotations import rotation_vector
from grainmotion.solvers.gauss_newton import Solution, Stopping, gauss_newton
from grainmotion.tracking.classification import classify
from grainmotion.tracking.refinement import RefinedFit
from grainmotion.uncertainty.covariance import covariances, regular_inverse
from grainmotion.uncertainty.rotation_identifiability import unconfirmed_rotations
from grainmotion.uncertainty.weak_directions import weak_directions

GRAINS = grain_set()
TRUTH = small_motions(GRAINS)
LIMITS = (0.5 * VOXEL, np.deg2rad(5.0))


def posed(truth):
    return Pose(truth.translations, truth.matrices)


def problem_of(scan, grains=GRAINS, sigma=0.7, gain=True):
    target = Target(
        scan,
        np.zeros(scan.line_integrals.shape, np.float32),
        "trilinear",
        sigma,
        GAIN_AND_OFFSET if gain else ResponseModel(),
    )
    return StateProblem(GrainArrays.of(grains, fine=True), target)


def judged(scan, pose, grains=GRAINS, limits=LIMITS, settled=True, last_step=None, doubtful=None, **target):
    """The verdict on a pose, as if the solver had ended there."""
    problem = problem_of(scan, grains, **target)
    at = problem.linearize(pose)
    step = np.zeros(6 * len(grains)) if last_step is None else last_step
    solution = Solution(pose, (at.cost,), step, settled)
    doubtful = np.zeros(len(grains), dtype=bool) if doubtful is None else doubtful
    return classify(grains, polished(problem, solution), doubtful, limits, (("free", 0.1), ("free", 0.05)))


def polished(problem, solution):
    """A solution with its covariances, nothing held."""
    evaluation = problem.evaluate_with_derivatives(solution.state)
    hessian = normal_matrix(evaluation.derivatives, evaluation.patches, len(problem.grains))
    known, _ = covariances(problem, solution.state, evaluation, hessian)
    known[:, 3:, 3:] += unconfirmed_rotations(problem, solution.state, evaluation)
    return RefinedFit(problem, solution, known, weak_directions(known, problem.grains).posterior())


class TestStatuses:
    def test_converged(self):
        found = judged(radiographs(GRAINS, TRUTH), posed(TRUTH))
        assert set(found.statuses) == {Status.CONVERGED.value}
        assert set(found.reasons) == {""}
        np.testing.assert_allclose(found.translations, TRUTH.translations)
        np.testing.assert_allclose(found.rotations, TRUTH.rotations, atol=1e-12)
        np.testing.assert_allclose(found.residuals, 0.01, rtol=0.1)
        assert set(found.iterations) == {2}
        assert found.fit.costs == (("free", 0.1), ("free", 0.05))
        assert found.fit.gain == pytest.approx(1, abs=2e-3)

    def test_wrong_place(self):
        """Two voxels off: the residual says so, and keeps the last value."""
        wrong = replace(TRUTH, translations=TRUTH.translations.copy())
        wrong.translations[2] += 2 * VOXEL
        found = judged(radiographs(GRAINS, TRUTH), posed(wrong))
        assert found.statuses[2] == Status.NOT_CONVERGED.value
        assert "residual" in found.reasons[2]
        np.testing.assert_allclose(found.translations[2], wrong.translations[2])
        assert found.ok[3:].all()  # what overlaps it may suffer, the others do not

    def test_a_grain_that_another_search_put_elsewhere(self):
        doubtful = np.arange(5) == 2
        found = judged(radiographs(GRAINS, TRUTH), posed(TRUTH), doubtful=doubtful)
        np.testing.assert_array_equal(found.statuses == Status.NOT_CONVERGED.value, doubtful)
        assert "elsewhere" in found.reasons[2]
        np.testing.assert_allclose(found.translations, TRUTH.translations)

    def test_without_any_noise_what_no_view_sees_is_still_unknown(self):
        """A residual of nothing is no proof that the depth in one parallel view is known."""
        views = Geometry.parallel([0.0], PANEL, VOXEL)
        found = judged(radiographs(GRAINS, TRUTH, views=views, noise=0.0), posed(TRUTH))
        assert set(found.statuses) == {Status.POORLY_DETERMINED.value}

    def test_few_pixels_for_each_unknown_are_told(self):
        scan = radiographs(GRAINS, TRUTH)
        assert not any("for each unknown" in note for note in judged(scan, posed(TRUTH)).fit.notes)
        few = np.zeros(scan.line_integrals.shape, bool)
        few[:, ::6, ::2] = True
        told = judged(replace(scan, valid=few), posed(TRUTH)).fit.notes
        assert any("pixels for each unknown are few" in note for note in told)

    def test_still_moving_when_iterations_ran_out(self):
        step = np.zeros(30)
        step[6 * 3] = 0.2 * VOXEL
        step[6 * 1] = 0.05 * VOXEL
        found = judged(radiographs(GRAINS, TRUTH), posed(TRUTH), settled=False, last_step=step)
        assert list(found.statuses == Status.NOT_CONVERGED.value) == [False, False, False, True, False]
        assert "track.iterations" in found.reasons[3]
        assert judged(radiographs(GRAINS, TRUTH), posed(TRUTH), last_step=step).ok.all()

    def test_turning_still_counts_as_moving(self):
        step = np.zeros(30)
        step[6 * 2 + 5] = 0.05  # radians, 0.3 voxel at the rim
        found = judged(radiographs(GRAINS, TRUTH), posed(TRUTH), settled=False, last_step=step)
        assert found.statuses[2] == Status.NOT_CONVERGED.value

    def test_left_field_and_not_fitted(self):
        truth = replace(TRUTH, translations=TRUTH.translations.copy())
        truth.translations[3] += [0, 0, 1.5]
        truth.translations[4] += [0, 0, 30]
        found = judged(radiographs(GRAINS, truth), posed(truth))
        assert found.statuses[3] == Status.LEFT_FIELD.value
        assert "of its shadows" in found.reasons[3]
        assert found.statuses[4] == Status.NOT_FITTED.value
        assert np.isnan(found.translations[3:]).all()
        assert np.isnan(found.rotations[3:]).all()
        assert np.isnan(found.covariances[3:]).all()
        assert found.ok[:3].all()

    def test_limits_decide_what_is_poorly_determined(self):
        scan = radiographs(GRAINS, TRUTH)
        found = judged(scan, posed(TRUTH), limits=(1e-9, 1.0))
        assert set(found.statuses) == {Status.POORLY_DETERMINED.value}
        assert "translation along any axis" in found.reasons[0]
        assert "rotation" not in found.reasons[0]
        turned = judged(scan, posed(TRUTH), limits=(1.0, 1e-9))
        assert "rotation about any axis" in turned.reasons[0]
        np.testing.assert_allclose(turned.translations, TRUTH.translations)  # kept, and marked

    def test_depth_in_one_parallel_view(self):
        grains = grain_set(1)
        truth = motions(grains)
        scan = radiographs(grains, truth, views=Geometry.parallel([0.0], PANEL, VOXEL))
        found = judged(scan, posed(truth), grains)
        assert found.statuses[0] == Status.POORLY_DETERMINED.value
        assert "translation along y" in found.reasons[0]
        sd = np.sqrt(np.diagonal(found.covariances[0]))
        assert sd[1] > 10 * max(sd[0], sd[2])  # what the prior leaves of an unknown depth


class TestCovariance:
    def test_scatter_of_many_noises(self):
        """Thirty noises: errors over stated standard deviations have a root mean square of one.

        The reference is exact here and the noise white, so nothing but the noise is asked of the covariance.
        """
        grains = grain_set(3)
        truth = small_motions(grains)
        clean = radiographs(grains, truth, noise=0.0)
        ratios = []
        for seed in range(30):
            noise = 0.05 * np.random.default_rng(seed).standard_normal(clean.line_integrals.shape)
            problem = problem_of(Scan(clean.line_integrals + noise.astype(np.float32), clean.geometry), grains)
            solution = gauss_newton(problem, posed(truth), Stopping(10, 1e-4))
            found = classify(grains, polished(problem, solution), np.zeros(3, dtype=bool), LIMITS, ())
            u = found.translations - truth.translations
            w = rotation_vector(found.matrices @ truth.matrices.transpose(0, 2, 1))
            ratios.append(np.hstack([u, w]) / np.sqrt(np.diagonal(found.covariances, axis1=1, axis2=2)))
        rms = np.sqrt(np.mean(np.square(ratios), axis=(0, 1)))
        assert np.sqrt(np.mean(rms**2)) == pytest.approx(1, abs=0.2)
        assert rms.min() > 0.6
        assert rms.max() < 1.6

    def test_more_noise_more_views_and_filters(self):
        def sd(noise=0.02, angles=ANGLES, sigma=0.7):
            scan = radiographs(GRAINS, TRUTH, views=geometry(angles), noise=noise)
            found = judged(scan, posed(TRUTH), sigma=sigma)
            return np.sqrt(np.diagonal(found.covariances, axis1=1, axis2=2))

        np.testing.assert_allclose(sd(noise=0.04), 2 * sd(noise=0.02), rtol=0.15)
        assert (sd(angles=(0.0, 30.0, 60.0, 90.0, 120.0, 150.0)) < sd(angles=(0.0, 90.0))).all()
        # a filter does not create information, and a mild one loses little
        assert (sd(sigma=0.7) > 0.85 * sd(sigma=0.0)).all()
        assert (sd(sigma=0.7) < 2 * sd(sigma=0.0)).all()

    def test_symmetric_and_positive(self):
        found = judged(radiographs(GRAINS, TRUTH), posed(TRUTH)).covariances
        np.testing.assert_allclose(found, found.transpose(0, 2, 1), rtol=1e-6, atol=1e-12)
        assert (np.linalg.eigvalsh(found) > 0).all()

    def test_an_honest_residual_is_of_the_stronger_noise(self):
        """A gain that drifted is not counted as noise."""
        plain = judged(radiographs(GRAINS, TRUTH), posed(TRUTH))
        drifted = judged(radiographs(GRAINS, TRUTH, gain=1.2), posed(TRUTH))
        np.testing.assert_allclose(drifted.residuals, plain.residuals, rtol=0.02)
        assert drifted.fit.gain == pytest.approx(1.2, abs=2e-3)

    def test_drawn_noise_comes_near_the_inverse(self, monkeypatch):
        """Standard deviations of many grains are drawn: right to the square root of 1 over twice the draws."""
        problem = problem_of(radiographs(GRAINS, TRUTH))
        pose, n = posed(TRUTH), len(GRAINS)
        evaluation = problem.evaluate_with_derivatives(pose)
        dense, _ = covariances(problem, pose, evaluation, normal_matrix(evaluation.derivatives, evaluation.patches, n))
        monkeypatch.setattr("grainmotion.objective.normal_matrix.MAX_DENSE_UNKNOWNS", 0)
        monkeypatch.setattr("grainmotion.solvers.block_cg.MAX_DENSE_UNKNOWNS", 0)
        monkeypatch.setattr("grainmotion.uncertainty.covariance.NOISE_DRAWS", 200)
        product = normal_of(evaluation.derivatives, evaluation.patches, n, evaluation.residual.shape)
        drawn, _ = covariances(problem, pose, evaluation, product)
        np.testing.assert_allclose(
            np.sqrt(np.diagonal(drawn, axis1=1, axis2=2)), np.sqrt(np.diagonal(dense, axis1=1, axis2=2)), rtol=0.15
        )
        assert (np.linalg.eigvalsh(drawn) > 0).all()


class TestRegularInverse:
    def test_unseen_directions_get_a_huge_variance_and_harm_no_other(self):
        matrix = np.diag([4.0, 1.0, 0.0, 9.0])
        inverse, unseen = regular_inverse(matrix)
        np.testing.assert_allclose(np.diagonal(inverse)[[0, 1, 3]], [1 / 4, 1, 1 / 9])
        assert inverse[2, 2] > 1e9
        np.testing.assert_allclose(np.diagonal(unseen)[[0, 1, 3]], 0)
        assert unseen[2, 2] == inverse[2, 2]
