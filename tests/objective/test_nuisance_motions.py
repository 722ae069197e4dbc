"""Nuisance motions (`objective.nuisance_motions`): views and bodies, their derivatives against re-projection."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import ndimage

from few_grains import GAIN_AND_OFFSET, VOXEL, blob, geometry, smooth_grains
from grainmotion.model.geometry import Geometry
from grainmotion.model.pose import NuisanceMotion, Pose, ViewCorrections
from grainmotion.model.scan import Scan
from grainmotion.model.scene import NO_MOTION, Freedom
from grainmotion.model.volume import Volume
from grainmotion.objective.data_term import Target
from grainmotion.objective.nuisance_motions import (
    NuisanceModel,
    body_images,
    corrected_geometry,
    nuisance_values,
    retract,
    view_derivatives,
)
from grainmotion.objective.residual import StateProblem
from grainmotion.projection.footprints import footprint_patches
from grainmotion.projection.grain_arrays import GrainArrays
from grainmotion.projection.grains import (
    assemble,
    body_image,
    differentiate_in_place,
    differentiated_body,
    project_patches,
)
from grainmotion.projection.volumes import project
from grainmotion.rotations import rotation_matrix
from scenes import packed


def off_axis():
    """A body off the axis."""
    return Volume(blob(19, 27, 21, 6, 4, 6), VOXEL)


def two_bodies():
    """It, and another."""
    return packed(off_axis()), packed(Volume(blob(23, 15, 28, 4, 5, 3), VOXEL))


PACKED = GrainArrays.of(smooth_grains())
POSE = Pose(np.array([[0.05, -0.08, 0.1], [-0.1, 0.03, 0.06]]), rotation_matrix([[0.1, 0.05, -0.2], [0.03, -0.1, 0.1]]))
VIEWS = 4
NO_BODIES = np.zeros((0, 3)), np.zeros((0, 3, 3))
FREE, ALONG_Z = Freedom.of("free"), Freedom.of("z wz")
BEAMS = {"cone": geometry(), "parallel": Geometry.parallel((0.0, 50.0, 95.0, 140.0), (52, 64), VOXEL)}
every_beam = pytest.mark.parametrize("views", BEAMS.values(), ids=BEAMS.keys())


def radiographs(views, at=None, pose=POSE):
    corrected = corrected_geometry(views, at)
    patches = footprint_patches(PACKED, pose, corrected)
    return assemble(project_patches(PACKED, pose, corrected, patches, "trilinear"), patches, corrected)


def one_correction(view, column, size):
    """A correction of one component of one view."""
    columns = np.zeros((VIEWS, 3))
    columns[view, column] = size
    return replace(NuisanceMotion.still(VIEWS), views=ViewCorrections.of(columns))


class TestViews:
    @every_beam
    @pytest.mark.parametrize(("column", "step"), [(0, 0.25), (1, 0.25), (2, 2e-4)], ids=["u", "v", "angle"])
    def test_derivatives_equal_finite_differences_of_radiographs(self, views, column, step):
        patches = footprint_patches(PACKED, POSE, views)
        path, jacobian = differentiate_in_place(PACKED, POSE, views, patches, "trilinear")
        path = assemble(path, patches, views)
        derivatives = view_derivatives(path, jacobian, PACKED, POSE)[column]
        difference = np.stack(
            [
                (
                    radiographs(views, one_correction(k, column, step))
                    - radiographs(views, one_correction(k, column, -step))
                )[k]
                / (2 * step)
                for k in range(VIEWS)
            ]
        )
        for one, other in zip(derivatives, difference, strict=True):
            assert np.linalg.norm(one - other) < (0.01 if column == 2 else 0.07) * np.linalg.norm(other)

    def test_a_correction_of_one_view_changes_no_other(self):
        change = radiographs(BEAMS["cone"], one_correction(2, 0, 0.5)) - radiographs(BEAMS["cone"])
        assert np.abs(change[2]).max() > 0.01
        assert not change[[0, 1, 3]].any()

    def test_derivatives_at_corrected_views(self):
        """Derivatives by the angle of views that are corrected already."""
        at = NuisanceMotion(ViewCorrections.of(np.array([[1.5, -2, 0.03]] * VIEWS)), *NO_BODIES)
        corrected = corrected_geometry(BEAMS["cone"], at)
        patches = footprint_patches(PACKED, POSE, corrected)
        path, jacobian = differentiate_in_place(PACKED, POSE, corrected, patches, "trilinear")
        by_angle = view_derivatives(assemble(path, patches, corrected), jacobian, PACKED, POSE)[2]
        ends = []
        for sign in (1, -1):
            views = replace(at.views, angles=at.views.angles + sign * 2e-4)
            ends.append(radiographs(BEAMS["cone"], replace(at, views=views)))
        difference = (ends[0] - ends[1]) / 4e-4
        assert np.linalg.norm(by_angle - difference) < 0.01 * np.linalg.norm(difference)


class TestCorrectedGeometry:
    @every_beam
    def test_a_shift_by_whole_pixels_is_a_shift_of_the_image(self, views):
        at = NuisanceMotion(ViewCorrections.of(np.tile([3.0, -2.0, 0.0], (VIEWS, 1))), *NO_BODIES)
        expected = radiographs(views)[:, :-2, 3:]
        np.testing.assert_allclose(radiographs(views, at)[:, 2:, :-3], expected, atol=1e-4)

    @every_beam
    def test_a_correction_of_the_angle_rotates_the_view(self, views):
        """A correction by the angle between two views turns one into the other."""
        at = one_correction(0, 2, np.deg2rad(50.0))
        np.testing.assert_allclose(corrected_geometry(views, at).vectors[0], views.vectors[1], atol=1e-9)
        np.testing.assert_array_equal(corrected_geometry(views, at).vectors[1:], views.vectors[1:])

    def test_without_motion_the_geometry_is_the_same(self):
        assert corrected_geometry(BEAMS["cone"], None) is BEAMS["cone"]
        assert corrected_geometry(BEAMS["cone"], NuisanceMotion.still(VIEWS)) is BEAMS["cone"]

    def test_the_given_geometry_is_not_changed(self):
        before = BEAMS["cone"].vectors.copy()
        corrected_geometry(BEAMS["cone"], one_correction(0, 0, 1.0))
        np.testing.assert_array_equal(BEAMS["cone"].vectors, before)


class TestBodies:
    SHIFT, MATRIX = np.array([0.2, -0.1, 0.15]), rotation_matrix(np.array([0.1, -0.2, 0.3]))

    def test_an_unmoved_body_has_the_projection_of_its_volume(self):
        image = body_image(packed(off_axis()), np.zeros(3), np.eye(3), BEAMS["cone"], "trilinear")
        np.testing.assert_allclose(image, project(off_axis(), BEAMS["cone"]), atol=1e-4)

    def test_derivatives_equal_finite_differences_of_radiographs(self):
        body, place = packed(off_axis()), (self.SHIFT, self.MATRIX)
        image, derivatives = differentiated_body(body, *place, BEAMS["cone"], "trilinear")
        np.testing.assert_allclose(image, body_image(body, *place, BEAMS["cone"], "trilinear"), atol=1e-12)
        for k, derivative in enumerate(derivatives):
            step = 1e-3 * np.eye(6)[k]
            ends = [
                body_image(
                    body,
                    self.SHIFT + sign * step[:3],
                    rotation_matrix(sign * step[3:]) @ self.MATRIX,
                    BEAMS["cone"],
                    "trilinear",
                )
                for sign in (1, -1)
            ]
            difference = (ends[0] - ends[1]) / 2e-3
            assert np.abs(difference).max() > 0.01
            assert np.linalg.norm(derivative - difference) < 0.01 * np.linalg.norm(difference)

    def test_rotates_about_its_centre_of_mass(self):
        """A rotation alone leaves the centroid of a parallel projection where it is."""
        centroids = []
        for matrix in (np.eye(3), self.MATRIX):
            image = body_image(packed(off_axis()), np.zeros(3), matrix, BEAMS["parallel"], "trilinear")
            mass = image.sum(axis=(1, 2))
            centroids.append([(image * k).sum(axis=(1, 2)) / mass for k in np.mgrid[:52, :64]])
        np.testing.assert_allclose(centroids[0], centroids[1], atol=0.02)

    def test_bodies_that_may_not_move_are_not_projected_again(self):
        bodies, views = two_bodies(), (BEAMS["cone"], "trilinear")
        fixed = np.full((VIEWS, *BEAMS["cone"].shape), 7.0)
        at = NuisanceMotion.still(VIEWS, 2)
        still = body_images(bodies, NuisanceModel((NO_MOTION, NO_MOTION)), at, views, fixed)
        np.testing.assert_array_equal(still.path, fixed)
        assert not still.derivatives
        one = body_images(bodies, NuisanceModel((NO_MOTION, FREE)), at, views, fixed)
        other = body_image(bodies[1], np.zeros(3), np.eye(3), *views)
        np.testing.assert_allclose(one.path, 7 + other, atol=1e-6)
        assert [k for k, *_ in one.derivatives] == [1]

    def test_corrected_views_show_all_bodies(self):
        bodies, model = two_bodies(), NuisanceModel((NO_MOTION, NO_MOTION))
        at = replace(NuisanceMotion.still(VIEWS, 2), views=ViewCorrections.of(np.tile([3.0, 0, 0], (VIEWS, 1))))
        corrected = corrected_geometry(BEAMS["cone"], at)
        images = body_images(bodies, model, at, (corrected, "trilinear"), np.full((VIEWS, *corrected.shape), 7.0))
        expected = sum(body_image(body, np.zeros(3), np.eye(3), corrected, "trilinear") for body in bodies)
        np.testing.assert_allclose(images.path, expected, atol=1e-6)


class TestSteps:
    BODIES_AND_VIEWS = NuisanceModel((FREE, NO_MOTION, ALONG_Z), views=True)

    def test_order_of_the_increments(self):
        step = np.arange(1.0, 21.0) / 100
        at = retract(self.BODIES_AND_VIEWS, NuisanceMotion.still(VIEWS, 3), step)
        np.testing.assert_allclose(at.views.shifts_pixels[:, 0], step[:4])
        np.testing.assert_allclose(at.views.shifts_pixels[:, 1], step[4:8])
        np.testing.assert_allclose(at.views.angles, step[8:12])
        np.testing.assert_allclose(at.translations, [step[12:15], np.zeros(3), [0, 0, step[18]]])
        np.testing.assert_allclose(at.matrices[0], rotation_matrix(step[15:18]))
        np.testing.assert_array_equal(at.matrices[1], np.eye(3))
        np.testing.assert_allclose(at.matrices[2], rotation_matrix(np.array([0, 0, step[19]])))
        np.testing.assert_allclose(nuisance_values(self.BODIES_AND_VIEWS, at), step)

    def test_rotations_are_composed(self):
        first, second = np.zeros((2, 20))
        first[15:18], second[15:18] = (0.3, -0.2, 0.5), (-0.4, 0.1, 0.2)
        at = retract(
            self.BODIES_AND_VIEWS, retract(self.BODIES_AND_VIEWS, NuisanceMotion.still(VIEWS, 3), first), second
        )
        np.testing.assert_allclose(at.matrices[0], rotation_matrix(second[15:18]) @ rotation_matrix(first[15:18]))

    def test_fixed_motions_do_not_change(self):
        start = NuisanceMotion(ViewCorrections.of(np.ones((VIEWS, 3))), np.ones((1, 3)), rotation_matrix([[0.1, 0, 0]]))
        at = retract(NuisanceModel((NO_MOTION,), views=True), start, np.full(12, 0.5))
        np.testing.assert_array_equal(at.translations, start.translations)
        np.testing.assert_array_equal(at.matrices, start.matrices)
        np.testing.assert_allclose(at.views.columns, 1.5)
        at = retract(NuisanceModel((FREE,)), start, np.full(6, 0.5))
        np.testing.assert_array_equal(at.views.columns, start.views.columns)

    def test_standard_deviations_and_precisions_of_the_prior(self):
        nuisance = replace(
            self.BODIES_AND_VIEWS,
            view_shift_sd_pixels=2.0,
            view_angle_sd=0.5,
            body_shift_sd=4.0,
            body_rotation_sd=0.1,
        )
        sd = nuisance.deviations(VIEWS)
        np.testing.assert_allclose(sd, [2.0] * 8 + [0.5] * 4 + [4.0] * 3 + [0.1] * 3 + [4.0, 0.1])
        np.testing.assert_allclose(nuisance.precisions(VIEWS), np.diag(1 / sd**2))
        gauge = np.zeros((20, 1))
        gauge[:4] = 0.5
        precisions_with_gauge = replace(nuisance, gauge=gauge).precisions(VIEWS)
        common, opposite = np.zeros((2, 20))
        common[:4], opposite[:2] = 1, (1, -1)
        assert common @ precisions_with_gauge @ common > 1e5
        assert opposite @ precisions_with_gauge @ opposite == pytest.approx(0.5)


class TestGradient:
    """Derivatives of the cost by the nuisance unknowns, with gain and offset eliminated, a filter and a mask."""

    def problem(self, nuisance):
        rng = np.random.default_rng(0)
        views_off = ViewCorrections.of(rng.normal(size=(VIEWS, 3)) * [0.4, 0.4, 0.006])
        shifts = np.array([[0.1, -0.1, 0.05], [0.0, 0.0, 0.1]])
        at = NuisanceMotion(views_off, shifts, np.tile(np.eye(3), (2, 1, 1)))
        views, bodies = BEAMS["cone"], two_bodies()
        corrected = corrected_geometry(views, at)
        images = radiographs(views, at)
        for body, shift in zip(bodies, shifts, strict=True):
            images = images + body_image(body, shift, np.eye(3), corrected, "trilinear")
        images = 1.1 * ndimage.gaussian_filter(images, (0, 0.5, 0.5)) + 0.02
        valid = rng.uniform(size=images.shape) > 0.05
        still = NuisanceModel((NO_MOTION,) * 2)
        target = Target(
            Scan(images, views, valid),
            np.zeros(images.shape),
            "trilinear",
            1.5,
            GAIN_AND_OFFSET,
            bodies=bodies,
            nuisance=still,
        ).with_fixed_bodies([k for k in (0, 1) if k not in nuisance.moving_bodies])
        target = replace(target, nuisance=nuisance)
        return StateProblem(PACKED, target)

    @pytest.mark.parametrize(
        "nuisance",
        [
            NuisanceModel((FREE, NO_MOTION)),
            NuisanceModel((NO_MOTION, NO_MOTION), True),
            NuisanceModel((FREE, ALONG_Z), True),
        ],
        ids=("one body", "views", "all"),
    )
    def test_gradient_equals_finite_differences_of_the_cost(self, nuisance):
        problem = self.problem(nuisance)
        rng = np.random.default_rng(1)
        size = nuisance.deviations(VIEWS)
        still = NuisanceMotion.still(VIEWS, 2)
        start = replace(POSE, nuisance=retract(nuisance, still, 0.1 * size * rng.normal(size=len(size))))
        at = problem.linearize(start)
        assert len(at.border_gradient) == len(size)
        differences = []
        for k in range(len(size)):
            step = 0.02 * size[k] * np.eye(12 + len(size))[12 + k]
            costs = [problem.linearize(problem.retract(start, sign * step)).cost for sign in (1, -1)]
            differences.append((costs[0] - costs[1]) / 0.04)
        np.testing.assert_allclose(at.border_gradient * size, differences, atol=0.03 * np.abs(differences).max())
