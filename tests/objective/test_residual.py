"""The residual of a state (`objective.residual`) and its normal equations, against dense and brute-force versions."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import ndimage, sparse

from grainmotion.model.pose import Pose
from grainmotion.objective import displacement_bases
from grainmotion.objective.normal_matrix import normal_matrix
from grainmotion.objective.residual import StateProblem
from grainmotion.projection.footprints import Patches, footprint_patches
from grainmotion.projection.grain_arrays import GrainArrays
from grainmotion.projection.grains import assemble, differentiate_patches, project_patches
from grainmotion.projection.jacobian import PatchJacobian
from grainmotion.rotations import rotation_matrix
from textured_lumps import GEOMETRY, GRAINS, PANEL, POSE, VOXEL, by_scipy, mask, measured, smooth_lumps, target


def dense_jacobian(problem, pose):
    """Filtered and masked ∂P as a matrix (pixels, 6 n), each column made from whole radiographs."""
    patches = footprint_patches(problem.grains, pose, GEOMETRY)
    _, derivatives = differentiate_patches(problem.grains, pose, GEOMETRY, patches, "trilinear")
    columns = []
    for grain in range(len(problem.grains)):
        for k in range(6):
            values = np.concatenate(
                [
                    np.where(box[0] == grain, 1, 0) * derivatives[k, patches.offsets[p] : patches.offsets[p + 1]]
                    for p, box in enumerate(patches.boxes)
                ]
            ).astype(np.float32)
            image = assemble(values, patches, GEOMETRY) * problem.target.valid
            columns.append(by_scipy(image, problem.target.kernel).ravel())
    return np.stack(columns, axis=1)


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
    def test_equal_dense_normal_equations(self, case, half_off):
        problem = StateProblem(GRAINS, target(**case))
        pose = replace(POSE, translations=POSE.translations + np.array([0, 0, 1.3 if half_off else 0]))
        at, evaluation = problem.linearize(pose), problem.evaluate_with_derivatives(pose)
        J = dense_jacobian(problem, pose)
        r = evaluation.residual.astype(float).ravel()
        assert at.cost == pytest.approx(0.5 * r @ r, rel=1e-5)
        a = evaluation.response.gain
        scale = a**2 * np.abs(J.T @ J).max()
        np.testing.assert_allclose(at.hessian.toarray(), a**2 * J.T @ J, atol=1e-5 * scale)
        np.testing.assert_allclose(at.gradient, -a * J.T @ r, atol=1e-5 * np.abs(J.T @ r).max() + 1e-7)
        if case.get("gain"):
            C = np.stack([stack.ravel() for stack in evaluation.response_columns.stacks], axis=1).astype(float)
            np.testing.assert_allclose(at.border, a * J.T @ C, rtol=1e-3, atol=1e-4 * np.abs(J.T @ C).max())
            np.testing.assert_allclose(at.corner, C.T @ C, rtol=1e-4)
        else:
            assert at.border.shape == (24, 0)

    @every_case
    def test_gradient_equals_central_differences_of_the_cost(self, case):
        """On smooth grains: the projection of rough ones has a kink wherever a sample changes voxel.

        No ray is near a diagonal of the voxels, where the dominant axis of the ray changes.
        """
        grains = GrainArrays.of(smooth_lumps())
        rotations = np.array([[0.05, 0.02, -0.04], [-0.03, 0.04, 0.03]])
        truth, start = (Pose(k * POSE.translations[:2], rotation_matrix(k * rotations)) for k in (1, -1))
        patches = footprint_patches(grains, truth, GEOMETRY)
        images = (
            1.05 * assemble(project_patches(grains, truth, GEOMETRY, patches, "trilinear"), patches, GEOMETRY) + 0.01
        )
        problem = StateProblem(grains, target(images=images, **case))
        gradient = problem.linearize(start).gradient.reshape(2, 6)

        def cost(pose):
            r = problem.evaluate_with_derivatives(pose).residual.astype(float)
            return 0.5 * (r * r).sum()

        differences = []
        for k in range(12):
            step = (5e-4 if k % 6 < 3 else 1e-3) * np.eye(12)[k]
            ends = [cost(problem.retract(start, sign * step)) for sign in (1, -1)]
            differences.append((ends[0] - ends[1]) / (2 * np.linalg.norm(step)))
        differences = np.reshape(differences, (2, 6))
        for unit in (slice(0, 3), slice(3, 6)):
            scale = np.abs(differences[:, unit]).max()
            assert scale > 1e-4
            np.testing.assert_allclose(gradient[:, unit], differences[:, unit], atol=0.02 * scale)

    def test_grains_without_a_common_pixel_are_not_coupled(self):
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
        assert not coupled[3, :3].any()  # the last grain is high above the others
        assert coupled[0, 1]

    def test_blocks_of_many_overlapping_patches(self):
        """There are blocks for just the pairs of patches that share pixels in a view."""
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
        derivatives = rng.normal(size=(6, offsets[-1])).astype(np.float32)
        dense = np.zeros((views, 50, 50, n, 6))
        for p, (g, i, top, bottom, left, right) in enumerate(boxes):
            patch = derivatives[:, offsets[p] : offsets[p + 1]].reshape(6, bottom - top, right - left)
            dense[i, top:bottom, left:right, g] = patch.transpose(1, 2, 0)
        J = dense.reshape(-1, 6 * n)

        patches = Patches(boxes, np.zeros((0, 4), np.int64), np.ones((n, views)), (50, 50))
        matrix = normal_matrix(PatchJacobian(derivatives, patches))
        np.testing.assert_allclose(matrix.toarray(), J.T @ J, atol=1e-4)

    def test_a_basis_transforms_gradient_and_matrix(self):
        """In double precision, because derivative images are summed before or after products are taken."""
        grains = replace(GRAINS, images=GRAINS.images.astype(float))
        double = replace(target(1.5, gain=True), fixed_background=np.zeros((3, *PANEL)))
        free = StateProblem(grains, double).linearize(POSE)
        in_basis = StateProblem(grains, double, displacement_bases.rigid).linearize(POSE)
        T = displacement_bases.rigid(GRAINS, POSE)
        np.testing.assert_allclose(in_basis.gradient, T.T @ free.gradient, rtol=1e-9)
        np.testing.assert_allclose(in_basis.hessian, T.T @ free.hessian.toarray() @ T, rtol=1e-6)
        np.testing.assert_allclose(in_basis.border, T.T @ free.border, rtol=1e-9)

    def test_finite_differences_are_close_to_derivatives(self):
        exact = StateProblem(GRAINS, target(sigma=1.5)).linearize(POSE)
        differences = StateProblem(GRAINS, target(sigma=1.5, derivatives="differences")).linearize(POSE)
        assert differences.cost == pytest.approx(exact.cost, rel=1e-6)
        H = exact.hessian.toarray()
        assert np.abs(differences.hessian.toarray() - H).max() < 0.02 * np.abs(H).max()

    def test_masked_values_do_not_matter(self):
        valid = mask()
        images = measured(noise=0.02)
        spoiled = np.where(valid, images, -1e5).astype(np.float32)
        one, other = (StateProblem(GRAINS, target(1.5, True, valid, i)).linearize(POSE) for i in (images, spoiled))
        assert one.cost == other.cost
        np.testing.assert_array_equal(one.gradient, other.gradient)
        np.testing.assert_array_equal(one.hessian.toarray(), other.hessian.toarray())

    def test_a_fixed_background_is_subtracted(self):
        background = ndimage.gaussian_filter(np.random.default_rng(6).uniform(0, 1, (3, *PANEL)), 2).astype(np.float32)
        images = measured(noise=0.02)
        plain = StateProblem(GRAINS, target(1.0, images=images)).linearize(POSE)
        with_background = target(1.0, images=images + background)
        subtracted = StateProblem(GRAINS, replace(with_background, fixed_background=background)).linearize(POSE)
        assert subtracted.cost == pytest.approx(plain.cost, rel=1e-4)
        np.testing.assert_allclose(subtracted.gradient, plain.gradient, atol=1e-4 * np.abs(plain.gradient).max())


class TestSteps:
    def test_a_step_of_a_grain_is_limited_to_its_size(self):
        """The step of a grain that is hardly determined is shortened; the steps of the others are unchanged."""
        problem, step = StateProblem(GRAINS, target()), np.full(24, 1e-3)
        step[6:12] *= 1e6
        moved = problem.retract(POSE, step)
        lengths = np.linalg.norm(moved.translations - POSE.translations, axis=1)
        assert lengths[1] <= 2 * GRAINS.radii[1]
        np.testing.assert_allclose(lengths[[0, 2, 3]], np.sqrt(3) * 1e-3)
        assert problem.step_sizes(POSE, step).max() == pytest.approx(2 * GRAINS.radii[1] / GRAINS.unit)

    def test_rotations_are_composed(self):
        step = np.arange(24) / 200  # well below the grains' own size
        moved = StateProblem(GRAINS, target()).retract(POSE, step)
        for k in range(4):
            u, w = step[6 * k : 6 * k + 3], step[6 * k + 3 : 6 * k + 6]
            np.testing.assert_allclose(moved.translations[k], POSE.translations[k] + u)
            np.testing.assert_allclose(moved.matrices[k], rotation_matrix(w) @ POSE.matrices[k])

    def test_step_size_is_the_displacement_of_the_surface_in_voxels(self):
        problem = StateProblem(GRAINS, target())
        step = np.zeros(24)
        step[6:9] = 0.3, 0.0, -0.4
        assert problem.step_sizes(POSE, step).max() == pytest.approx(0.5 / VOXEL)
        step = np.zeros(24)
        step[22] = 0.1
        assert 0.1 * 4 < problem.step_sizes(POSE, step)[3] < 0.1 * 8  # a cube of 8 voxels: its surface is 4 to 7 away
