"""The residual of a state and its normal equations, against dense and brute-force versions of themselves."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import ndimage, sparse

from few_grains import GAIN_AND_OFFSET
from grainmotion.model.geometry import Geometry
from grainmotion.model.pose import Pose
from grainmotion.model.scan import Scan
from grainmotion.model.volume import Volume
from grainmotion.objective import displacement_bases
from grainmotion.objective.data_term import Target, gaussian
from grainmotion.objective.global_parameters import Columns
from grainmotion.objective.normal_matrix import normal_matrix
from grainmotion.objective.residual import StateProblem
from grainmotion.objective.response_parameters import ResponseModel, fit_response
from grainmotion.projection.grain_arrays import GrainArrays
from grainmotion.projection.grains import assemble, differentiate_patches, project_patches, shadows
from grainmotion.rotations import rotation_matrix
from grainmotion.segmentation.extraction import grains_from_labels
from grainmotion.uncertainty.goodness_of_fit import Misfits, misfits
from grainmotion.uncertainty.noise_model import noise_level

PANEL = (34, 46)
VOXEL = 0.1
GEOMETRY = Geometry.cone([0.0, 55.0, 100.0], PANEL, 0.4, source_to_axis=30, source_to_detector=120)


def lumps():
    """Four textured lumps; the last one is away from the others."""
    rng = np.random.default_rng(0)
    array = np.zeros((26, 12, 34), np.float32)
    labels = np.zeros(array.shape, np.int32)
    for label, (z, y, x) in enumerate([(3, 1, 2), (4, 2, 11), (2, 1, 20), (16, 3, 22)], start=1):
        array[z : z + 8, y : y + 8, x : x + 8] = ndimage.gaussian_filter(rng.uniform(0, 2, (8, 8, 8)), 0.8)
        labels[z : z + 8, y : y + 8, x : x + 8] = label
    return grains_from_labels(Volume(array, VOXEL), labels, reach=0)


def smooth_lumps():
    """Two long Gaussian lumps side by side, which no voxel's edge disturbs."""
    z, y, x = np.mgrid[:24, :20, :36].astype(float)
    left = 2 * np.exp(-(((x - 10) / 2.5) ** 2 + ((y - 10 - 0.3 * (x - 10)) / 1.8) ** 2 + ((z - 12) / 3) ** 2) / 2)
    right = 2 * np.exp(-(((x - 25) / 2) ** 2 + ((y - 9) / 2.5) ** 2 + ((z - 12 + 0.4 * (x - 25)) / 2) ** 2) / 2)
    both = [np.where(lump > 1e-3, lump, 0) for lump in (left, right)]
    labels = np.where(both[0] > both[1], 1, np.where(both[1] > 0, 2, 0))
    return grains_from_labels(Volume(both[0] + both[1], VOXEL), labels, reach=0)


GRAINS = GrainArrays.of(lumps())
POSE = Pose(
    0.05 * np.random.default_rng(1).normal(size=(4, 3)),
    rotation_matrix(0.3 * np.random.default_rng(2).normal(size=(4, 3))),
)


def mask():
    valid = np.random.default_rng(3).uniform(size=(3, *PANEL)) > 0.05
    valid[:, 17] = False
    return valid


def measured(gain=1.0, offset=0.0, noise=0.0, pose=POSE):
    patches = shadows(GRAINS, pose, GEOMETRY)
    images = gain * assemble(project_patches(GRAINS, pose, GEOMETRY, patches, "trilinear"), patches, GEOMETRY) + offset
    return images + (noise * np.random.default_rng(4).standard_normal(images.shape)).astype(np.float32)


def target(sigma=0.0, gain=False, valid=None, images=None, **changes):
    scan = Scan(measured(noise=0.02) if images is None else images, GEOMETRY, valid)
    response_model = GAIN_AND_OFFSET if gain else ResponseModel()
    return Target(scan, np.zeros((3, *PANEL), np.float32), "trilinear", sigma, response_model, **changes)


def dense_jacobian(problem, pose):
    """Filtered and masked ∂P as a matrix (pixels, 6 n), each column made from whole radiographs."""
    patches = shadows(problem.grains, pose, GEOMETRY)
    _, slopes = differentiate_patches(problem.grains, pose, GEOMETRY, patches, "trilinear")
    columns = []
    for grain in range(len(problem.grains)):
        for k in range(6):
            mine = np.concatenate(
                [
                    np.where(box[0] == grain, 1, 0) * slopes[k, patches.offsets[p] : patches.offsets[p + 1]]
                    for p, box in enumerate(patches.boxes)
                ]
            ).astype(np.float32)
            image = assemble(mine, patches, GEOMETRY) * problem.target.valid
            columns.append(by_scipy(image, problem.target.kernel).ravel())
    return np.stack(columns, axis=1)


def by_scipy(images, weights):
    """Convolution of every radiograph with the whole kernel, zero beyond its edges."""
    kernel = np.concatenate([weights[:0:-1], weights]).astype(float)
    images = images.astype(float)
    for axis in (1, 2):
        images = ndimage.convolve1d(images, kernel, axis=axis, mode="constant")
    return images


class TestFilter:
    @pytest.mark.parametrize("sigma", [0.3, 0.7, 2.0, 6.0, 40.0])
    def test_kernel(self, sigma):
        half = gaussian(sigma)
        whole = np.concatenate([half[:0:-1], half]).astype(float)
        assert whole.sum() == pytest.approx(1, abs=1e-6)
        assert (np.diff(half) < 0).all()
        if sigma >= 0.7:
            k = np.arange(len(whole)) - len(half) + 1
            assert np.sqrt((whole * k**2).sum()) == pytest.approx(sigma, rel=0.02)

    def test_no_filter(self):
        np.testing.assert_array_equal(gaussian(0), [1])
        images = measured(noise=0.1)
        np.testing.assert_array_equal(target().filtered(images), images)

    @pytest.mark.parametrize("sigma", [0.5, 2.0, 20.0])  # the last kernel is wider than the panel
    def test_radiographs_are_convolved(self, sigma):
        images = measured(noise=0.1)
        images[1] = 0
        images[1, 0, 0] = images[1, -1, -1] = 1  # corners
        found = target(sigma).filtered(images)
        np.testing.assert_allclose(found, by_scipy(images, gaussian(sigma)), atol=2e-6)
        assert found is not images

    def test_masked_pixels_count_as_zero_before_the_filter(self):
        valid = mask()
        images = measured(noise=0.1)
        absurd = np.where(valid, images, 1e6).astype(np.float32)
        found = target(1.5, valid=valid).filtered(absurd)
        np.testing.assert_allclose(found, by_scipy(np.where(valid, images, 0), gaussian(1.5)), atol=2e-6)


CASES = {
    "plain": {},
    "filtered": {"sigma": 1.5},
    "wide filter": {"sigma": 6.0},
    "masked": {"valid": mask()},
    "filtered, masked, with gain": {"sigma": 1.5, "valid": mask(), "gain": True},
    "with gain": {"gain": True},
}
every_case = pytest.mark.parametrize("case", CASES.values(), ids=CASES.keys())


class TestNormalEquations:
    @every_case
    @pytest.mark.parametrize("half_off", [False, True])
    def test_against_dense_ones(self, case, half_off):
        problem = StateProblem(GRAINS, target(**case))
        pose = replace(POSE, translations=POSE.translations + np.array([0, 0, 1.3 if half_off else 0]))
        at, seen = problem.linearize(pose), problem.evaluate_with_derivatives(pose)
        J = dense_jacobian(problem, pose)
        r = seen.residual.astype(float).ravel()
        assert at.cost == pytest.approx(0.5 * r @ r, rel=1e-5)
        a = seen.response.gain
        scale = a**2 * np.abs(J.T @ J).max()
        np.testing.assert_allclose(at.hessian.toarray(), a**2 * J.T @ J, atol=1e-5 * scale)
        np.testing.assert_allclose(at.gradient, -a * J.T @ r, atol=1e-5 * np.abs(J.T @ r).max() + 1e-7)
        if case.get("gain"):
            C = np.stack([stack.ravel() for stack in seen.response_columns.stacks], axis=1).astype(float)
            np.testing.assert_allclose(at.border, a * J.T @ C, rtol=1e-3, atol=1e-4 * np.abs(J.T @ C).max())
            np.testing.assert_allclose(at.corner, C.T @ C, rtol=1e-4)
        else:
            assert at.border.shape == (24, 0)

    @every_case
    def test_gradient_is_the_slope_of_the_cost(self, case):
        """By central differences, on smooth lumps: rough ones have corners wherever a sample changes voxel.

        No ray runs near a diagonal of the voxels, where the walk changes from one dominant axis to another.
        """
        grains = GrainArrays.of(smooth_lumps())
        turns = np.array([[0.05, 0.02, -0.04], [-0.03, 0.04, 0.03]])
        truth, start = (Pose(k * POSE.translations[:2], rotation_matrix(k * turns)) for k in (1, -1))
        patches = shadows(grains, truth, GEOMETRY)
        images = (
            1.05 * assemble(project_patches(grains, truth, GEOMETRY, patches, "trilinear"), patches, GEOMETRY) + 0.01
        )
        problem = StateProblem(grains, target(images=images, **case))
        gradient = problem.linearize(start).gradient.reshape(2, 6)

        def cost(pose):
            r = problem.evaluate_with_derivatives(pose).residual.astype(float)
            return 0.5 * (r * r).sum()

        found = []
        for k in range(12):
            step = (5e-4 if k % 6 < 3 else 1e-3) * np.eye(12)[k]
            ends = [cost(problem.retract(start, sign * step)) for sign in (1, -1)]
            found.append((ends[0] - ends[1]) / (2 * np.linalg.norm(step)))
        found = np.reshape(found, (2, 6))
        for unit in (slice(0, 3), slice(3, 6)):
            scale = np.abs(found[:, unit]).max()
            assert scale > 1e-4
            np.testing.assert_allclose(gradient[:, unit], found[:, unit], atol=0.02 * scale)

    def test_grains_whose_shadows_never_meet_are_not_coupled(self):
        problem = StateProblem(GRAINS, target())
        pose = Pose(np.array([[0.0, 0, 0]] * 3 + [[0, 0, 0.2]]), np.tile(np.eye(3), (4, 1, 1)))
        hessian = problem.linearize(pose).hessian
        assert isinstance(hessian, sparse.bsr_array)
        assert hessian.blocksize == (6, 6)
        coupled = sparse.csr_array(
            (np.ones(len(hessian.indices)), hessian.indices, hessian.indptr), shape=(4, 4)
        ).toarray()
        np.testing.assert_array_equal(coupled, coupled.T)
        assert coupled.diagonal().all()
        assert not coupled[3, :3].any()  # the last lump is high above the others
        assert coupled[0, 1]

    def test_overlaps_of_many_boxes(self):
        """Blocks are found for just the pairs of patches that share pixels in a view."""
        rng = np.random.default_rng(5)
        n, views = 30, 3
        grain, view = (a.ravel() for a in np.meshgrid(np.arange(n), np.arange(views), indexing="ij"))
        r0, c0 = rng.integers(0, 40, (2, n * views))
        boxes = np.column_stack(
            [grain, view, r0, r0 + rng.integers(1, 9, n * views), c0, c0 + rng.integers(1, 9, n * views)]
        )
        rng.shuffle(boxes)
        sizes = (boxes[:, 3] - boxes[:, 2]) * (boxes[:, 5] - boxes[:, 4])
        offsets = np.concatenate([[0], np.cumsum(sizes)])
        slopes = rng.normal(size=(6, offsets[-1])).astype(np.float32)
        dense = np.zeros((views, 50, 50, n, 6))
        for p, (g, i, top, bottom, left, right) in enumerate(boxes):
            patch = slopes[:, offsets[p] : offsets[p + 1]].reshape(6, bottom - top, right - left)
            dense[i, top:bottom, left:right, g] = patch.transpose(1, 2, 0)
        J = dense.reshape(-1, 6 * n)

        class Boxes:
            pass

        patches = Boxes()
        patches.boxes, patches.offsets = boxes, offsets
        np.testing.assert_allclose(normal_matrix(slopes, patches, n).toarray(), J.T @ J, atol=1e-4)

    def test_ties_carry_gradient_and_matrix(self):
        """In double precision: the tied one sums images before it compares them, the free one afterwards."""
        grains = replace(GRAINS, images=GRAINS.images.astype(float))
        double = replace(target(1.5, gain=True), fixed_background=np.zeros((3, *PANEL)))
        free = StateProblem(grains, double).linearize(POSE)
        tied = StateProblem(grains, double, displacement_bases.rigid).linearize(POSE)
        T = displacement_bases.rigid(GRAINS, POSE)
        np.testing.assert_allclose(tied.gradient, T.T @ free.gradient, rtol=1e-9)
        np.testing.assert_allclose(tied.hessian, T.T @ free.hessian.toarray() @ T, rtol=1e-6)
        np.testing.assert_allclose(tied.border, T.T @ free.border, rtol=1e-9)

    def test_finite_differences_are_near(self):
        one = StateProblem(GRAINS, target(sigma=1.5)).linearize(POSE)
        other = StateProblem(GRAINS, target(sigma=1.5, derivatives="differences")).linearize(POSE)
        assert other.cost == pytest.approx(one.cost, rel=1e-6)
        H = one.hessian.toarray()
        assert np.abs(other.hessian.toarray() - H).max() < 0.02 * np.abs(H).max()

    def test_masked_values_do_not_matter(self):
        valid = mask()
        images = measured(noise=0.02)
        absurd = np.where(valid, images, -1e5).astype(np.float32)
        one, other = (StateProblem(GRAINS, target(1.5, True, valid, i)).linearize(POSE) for i in (images, absurd))
        assert one.cost == other.cost
        np.testing.assert_array_equal(one.gradient, other.gradient)
        np.testing.assert_array_equal(one.hessian.toarray(), other.hessian.toarray())

    def test_what_is_fixed_is_taken_off(self):
        background = ndimage.gaussian_filter(np.random.default_rng(6).uniform(0, 1, (3, *PANEL)), 2).astype(np.float32)
        images = measured(noise=0.02)
        plain = StateProblem(GRAINS, target(1.0, images=images)).linearize(POSE)
        with_it = target(1.0, images=images + background)
        there = StateProblem(GRAINS, replace(with_it, fixed_background=background)).linearize(POSE)
        assert there.cost == pytest.approx(plain.cost, rel=1e-4)
        np.testing.assert_allclose(there.gradient, plain.gradient, atol=1e-4 * np.abs(plain.gradient).max())


class TestNothingToSee:
    """No view sees any grain, or no pixel counts: zeros, no error."""

    @pytest.mark.parametrize("gain", [False, True])
    def test_all_grains_off_the_panel(self, gain):
        away = replace(POSE, translations=POSE.translations + np.array([0, 0, 1e3]))
        problem = StateProblem(GRAINS, target(1.0, gain))
        at = problem.linearize(away)
        assert np.isfinite(at.cost)
        assert not at.gradient.any()
        assert at.hessian.nnz == 0
        seen = problem.evaluate_with_derivatives(away)
        assert (seen.response.gain, seen.response.offset) == (1.0, 0.0)
        assert misfits(problem, seen).misregistered.all()

    @pytest.mark.parametrize("gain", [False, True])
    def test_all_pixels_invalid(self, gain):
        problem = StateProblem(GRAINS, target(1.0, gain, np.zeros((3, *PANEL), bool)))
        at = problem.linearize(POSE)
        assert at.cost == 0
        assert not at.gradient.any()
        assert misfits(problem, problem.evaluate_with_derivatives(POSE)).misregistered.all()

    def test_one_empty_view(self):
        valid = np.ones((3, *PANEL), bool)
        valid[1] = False
        at = StateProblem(GRAINS, target(1.0, valid=valid)).linearize(POSE)
        two = Scan(measured(noise=0.02)[[0, 2]], GEOMETRY[[0, 2]])
        other = Target(two, np.zeros((2, *PANEL), np.float32), "trilinear", 1.0)
        expected = StateProblem(GRAINS, other).linearize(POSE)
        assert at.cost == pytest.approx(expected.cost, rel=1e-6)
        np.testing.assert_allclose(at.gradient, expected.gradient, rtol=1e-5, atol=1e-4)


class TestGain:
    @pytest.mark.parametrize(("gain", "offset"), [(1.0, 0.0), (1.1, 0.0), (0.9, 0.05), (1.3, -0.2)])
    @pytest.mark.parametrize("sigma", [0.0, 2.0])
    def test_planted_ones_are_found(self, gain, offset, sigma):
        problem = StateProblem(GRAINS, target(sigma, True, mask(), measured(gain, offset)))
        seen = problem.evaluate_with_derivatives(POSE)
        assert seen.response.gain == pytest.approx(gain, abs=1e-5)
        assert seen.response.offset == pytest.approx(offset, abs=1e-5)
        assert problem.linearize(POSE).cost < 1e-6

    def test_degenerate(self):
        """Where nothing is simulated nothing is fitted; an even radiograph is fitted, whatever its parts."""
        ones = np.ones((1, 4, 4), np.float32)
        nothing, _ = fit_response(GAIN_AND_OFFSET, Columns([0 * ones, ones], [True, True]), 3 * ones, 1)
        assert (nothing.gain, nothing.offset) == (1.0, 0.0)
        even, more = fit_response(GAIN_AND_OFFSET, Columns([2 * ones, ones], [True, True]), ones, 1)
        np.testing.assert_allclose(more, ones, rtol=1e-6)
        assert np.isfinite([even.gain, even.offset]).all()

    def test_the_cost_cannot_rise_by_eliminating(self):
        images = measured(1.07, 0.02, 0.05)
        with_gain = StateProblem(GRAINS, target(1.0, True, images=images)).linearize(POSE).cost
        without = StateProblem(GRAINS, target(1.0, False, images=images)).linearize(POSE).cost
        assert with_gain < without


class TestCrowds:
    """Grains one behind the other."""

    def test_line_integrals_of_a_crowd_add_up_in_squares(self):
        one, nine = (misfits(problem := crowd(k), problem.evaluate(still(k))) for k in (1, 9))
        np.testing.assert_allclose(one.rms_crowd_integrals, one.rms_line_integrals, rtol=1e-5)
        np.testing.assert_allclose(nine.rms_line_integrals, one.rms_line_integrals[0], rtol=1e-5)
        np.testing.assert_allclose(nine.rms_crowd_integrals, 3 * one.rms_line_integrals[0], rtol=1e-5)

    @pytest.mark.parametrize(("many", "share"), [(1, 0.04), (30, 0.04 * np.sqrt(30))])
    def test_what_all_of_them_leave_accuses_none(self, many, share):
        """Each leaves 4 % of its line integrals, as grains of voxels do."""
        crowds = np.full(many, np.sqrt(many))
        assert not Misfits(np.full(many, share), np.ones(many), crowds, 0.0).misregistered.any()

    def test_one_in_a_wrong_place_stands_out_of_them(self):
        residuals = 0.03 * np.sqrt(30) * np.ones(30)
        residuals[7] = np.hypot(residuals[7], 0.25)
        lost = Misfits(residuals, np.ones(30), np.full(30, np.sqrt(30)), 0.0).misregistered
        np.testing.assert_array_equal(np.flatnonzero(lost), [7])

    def test_all_in_wrong_places_are_all_lost(self):
        found = Misfits(np.full(30, 0.25 * np.sqrt(30)), np.ones(30), np.full(30, np.sqrt(30)), 0.0)
        assert found.misregistered.all()
        assert found.misregistered_in_crowd.all()

    def test_near_is_not_astray(self):
        """Half-way through, each of 30 leaves 9 %: all together look lost, but none is far."""
        found = Misfits(np.full(30, 0.09 * np.sqrt(30)), np.ones(30), np.full(30, np.sqrt(30)), 0.0)
        assert found.misregistered.all()
        assert not found.misregistered_in_crowd.any()


def still(many):
    """No motion of so many grains."""
    return Pose(np.zeros((many, 3)), np.broadcast_to(np.eye(3), (many, 3, 3)).copy())


def crowd(many):
    """The same grain, so many times in the same place."""
    return StateProblem(GRAINS.select([1] * many), target())


class TestSteps:
    def test_no_grain_alone_goes_further_than_its_own_size(self):
        """One that is hardly seen is not flung away; the others' steps are as they were."""
        problem, step = StateProblem(GRAINS, target()), np.full(24, 1e-3)
        step[6:12] *= 1e6
        moved = problem.retract(POSE, step)
        gone = np.linalg.norm(moved.translations - POSE.translations, axis=1)
        assert gone[1] <= 2 * GRAINS.radii[1]
        np.testing.assert_allclose(gone[[0, 2, 3]], np.sqrt(3) * 1e-3)
        assert problem.step_sizes(POSE, step).max() == pytest.approx(2 * GRAINS.radii[1] / GRAINS.unit)

    def test_on_the_group(self):
        step = np.arange(24) / 200  # well below the grains' own size
        moved = StateProblem(GRAINS, target()).retract(POSE, step)
        for k in range(4):
            u, w = step[6 * k : 6 * k + 3], step[6 * k + 3 : 6 * k + 6]
            np.testing.assert_allclose(moved.translations[k], POSE.translations[k] + u)
            np.testing.assert_allclose(moved.matrices[k], rotation_matrix(w) @ POSE.matrices[k])

    def test_size_is_the_surfaces_path_in_voxels(self):
        problem = StateProblem(GRAINS, target())
        step = np.zeros(24)
        step[6:9] = 0.3, 0.0, -0.4
        assert problem.step_sizes(POSE, step).max() == pytest.approx(0.5 / VOXEL)
        step = np.zeros(24)
        step[22] = 0.1
        assert 0.1 * 4 < problem.step_sizes(POSE, step)[3] < 0.1 * 8  # a lump of 8 voxels: its rim is 4 to 7 away


class TestMisfits:
    def test_planted_misfit_of_one_grain(self):
        pose = replace(POSE, translations=POSE.translations.copy())
        pose.translations[3] += [0.2, 0.1, -0.15]
        problem = StateProblem(GRAINS, target(images=measured(noise=1e-4)))
        found = misfits(problem, problem.evaluate_with_derivatives(pose))
        assert found.rms_residuals[3] > 20 * found.rms_residuals[:3].max()
        assert (found.rms_line_integrals > 0.3).all()
        np.testing.assert_array_equal(found.misregistered, [False, False, False, True])

    def test_even_misfit(self):
        problem = StateProblem(GRAINS, target(images=measured(offset=0.07)))
        np.testing.assert_allclose(
            misfits(problem, problem.evaluate_with_derivatives(POSE)).rms_residuals, 0.07, rtol=1e-3
        )

    def test_masked_pixels_do_not_count(self):
        valid = mask()
        images = np.where(valid, measured(), 1e4).astype(np.float32)
        problem = StateProblem(GRAINS, target(valid=valid, images=images))
        assert misfits(problem, problem.evaluate_with_derivatives(POSE)).rms_residuals.max() < 1e-5

    def test_noise_is_no_misfit(self):
        assert not alone([0.02, 0.021, 0.019, 0.022], 0.02).misregistered.any()

    def test_unknown_is_a_misfit(self):
        np.testing.assert_array_equal(alone([0.02, np.nan], 0.02).misregistered, [False, True])

    def test_all_bad_is_seen_by_the_noise(self):
        """When every grain fits badly, none stands out from the others; the noise tells."""
        assert alone([0.2] * 5, 0.02).misregistered.all()

    def test_thin_shadows_in_strong_noise_do_not_accuse(self):
        assert not alone([0.05], 0.03).misregistered.any()


def alone(residuals, noise):
    """Grains on rays of their own."""
    paths = np.where(np.isfinite(residuals), 1.0, np.nan)
    return Misfits(np.array(residuals), paths, paths, noise)


class TestNoiseLevel:
    @pytest.mark.parametrize("noise", [0.005, 0.03])
    def test_white_noise_on_smooth_shadows(self, noise):
        rng = np.random.default_rng(7)
        shadow = np.hypot(*(np.mgrid[:34, :46] - np.array([17, 23])[:, None, None]) / 6) ** 2
        images = np.exp(-shadow) + noise * rng.standard_normal((3, *PANEL))
        assert noise_level(Scan(images, GEOMETRY)) == pytest.approx(noise, rel=0.15)

    def test_no_noise(self):
        assert noise_level(Scan(np.zeros((3, *PANEL), np.float32), GEOMETRY)) == 0

    def test_a_panel_too_narrow_to_tell(self):
        assert noise_level(Scan(np.zeros((1, 5, 2), np.float32), Geometry.parallel([0.0], (5, 2), 1.0))) == 0
