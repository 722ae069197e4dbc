"""Laws that line integrals obey, for both projectors, in cone and parallel beams from straight and tilted views."""

import numpy as np
import pytest
from scipy import ndimage

from grainmotion.backends.cpu import CPU
from grainmotion.kernels import volume_projection
from grainmotion.kernels.layout import ViewTable
from grainmotion.model.detector_alignment import DetectorAlignment
from grainmotion.model.geometry import Geometry
from grainmotion.model.grains import GrainSet
from grainmotion.model.motions import Motions
from grainmotion.model.pose import Pose
from grainmotion.model.volume import Volume
from grainmotion.projection.footprints import footprint_patches
from grainmotion.projection.grain_arrays import GrainArrays
from grainmotion.projection.grains import difference_patches, differentiate_patches, simulate_radiographs
from grainmotion.projection.volume_operator import pad, padded_origin
from grainmotion.projection.volumes import back_project, project
from grainmotion.rotations import apply_motion, rotation_matrix, rotation_vector
from grainmotion.segmentation.extraction import grains_from_labels
from grainmotion.simulate import Ellipsoid, Particle, Sample, attenuation_volume, line_integrals
from scenes import one_body

PANEL = (13, 16)
TILTED = DetectorAlignment(
    detector_offset=(0.2, -0.1),
    detector_tilts_deg=(8, -5, 11),
    axis_offset=0.15,
    axis_tilt_deg=(4, -3),
    first_row="top",
)
PROJECTORS = ("trilinear", "exact")


def _along_z(beam):
    """Views whose rays run mostly along z, and one along −x: every axis dominates somewhere."""
    start = [0.1, 0.2, -9] if beam == "cone" else [0.02, 0.01, 1]
    down = [*start, 0.3, 0.1, 20, 0.3, 0.05, 0, -0.04, 0.3, 0.01]
    start = [9, 0.1, 0.2] if beam == "cone" else [-1, 0.02, 0.03]
    left = [*start, -20, 0.3, 0.1, 0.02, 0.3, 0, 0, 0.03, 0.31]
    return Geometry(np.array([down, left]), PANEL, beam)


GEOMETRIES = {
    "cone": Geometry.cone([0.0, 38.0, 90.0, 211.0], PANEL, 0.3, source_to_axis=8, source_to_detector=20),
    "cone, tilted": Geometry.cone([5.0, 100.0], PANEL, 0.3, source_to_axis=8, source_to_detector=20, panel=TILTED),
    "cone, along z and x": _along_z("cone"),
    "parallel": Geometry.parallel([0.0, 45.0, 90.0, 250.0], PANEL, 0.12),
    "parallel, tilted": Geometry.parallel([12.0, 77.0], PANEL, 0.12, panel=TILTED),
    "parallel, along z and x": _along_z("parallel"),
}
every_geometry = pytest.mark.parametrize("geometry", GEOMETRIES.values(), ids=GEOMETRIES.keys())
every_projector = pytest.mark.parametrize("projector", PROJECTORS)
VOXEL, CENTER = 0.13, (0.11, -0.07, 0.05)


def random_volume(seed=0, shape=(7, 9, 8), negative=False):
    values = np.random.default_rng(seed).uniform(-1 if negative else 0, 1, shape)
    return Volume(values, VOXEL, CENTER)


def double_forward(array, geometry, projector, origin, voxel=VOXEL):
    """The forward kernel in double precision; ``array`` is padded already."""
    out = np.empty((len(geometry), *geometry.shape))
    volume_projection.forward(
        array, np.asarray(origin, float), voxel, geometry.vectors, geometry.beam == "cone", projector == "exact", out
    )
    return out


def rays(geometry):
    """A point and a unit direction of every ray, ``(views, rows, columns, 3)``, by the definition of a view."""
    pixels = np.stack([geometry.pixel_positions(i) for i in range(len(geometry))])
    if geometry.beam == "cone":
        directions = pixels - geometry.vectors[:, None, None, :3]
    else:
        directions = np.broadcast_to(geometry.vectors[:, None, None, :3], pixels.shape)
    return pixels, directions / np.linalg.norm(directions, axis=-1, keepdims=True)


class TestMatchedAdjoint:
    """⟨A x, y⟩ = ⟨x, Aᵀ y⟩."""

    @every_geometry
    @every_projector
    def test_adjoint_of_kernels_in_double_precision(self, geometry, projector):
        rng = np.random.default_rng(1)
        x = pad(rng.normal(size=(7, 9, 8)))
        y = rng.normal(size=(len(geometry), *PANEL))
        origin = padded_origin(random_volume())
        back = np.zeros_like(x)
        volume_projection.adjoint(
            y, origin, VOXEL, geometry.vectors, geometry.beam == "cone", projector == "exact", back
        )
        forward = double_forward(x, geometry, projector, origin)
        assert np.abs(forward).max() > 0.5  # the body is in view
        assert np.vdot(forward, y) == pytest.approx(np.vdot(x, back), rel=1e-11)

    @every_geometry
    @every_projector
    def test_adjoint_of_volumes_in_single_precision(self, geometry, projector):
        rng = np.random.default_rng(2)
        x, y = random_volume(), rng.uniform(size=(len(geometry), *PANEL)).astype(np.float32)
        back = back_project(y, geometry, x, projector=projector)
        assert (back.shape, back.voxel_size, back.center) == (x.shape, VOXEL, CENTER)
        forward = project(x, geometry, projector=projector)
        one = np.vdot(forward.astype(float), y)
        assert one == pytest.approx(np.vdot(x.array.astype(float), back.array), rel=1e-5)

    @every_projector
    def test_back_projection_adds_up_and_skips_empty_pixels(self, projector):
        geometry = GEOMETRIES["cone"]
        y = np.zeros((len(geometry), *PANEL), np.float32)
        assert not back_project(y, geometry, random_volume(), projector=projector).array.any()
        y[1, 6, 7] = 2.0
        one = back_project(y, geometry, random_volume(), projector=projector).array
        np.testing.assert_allclose(
            back_project(2 * y, geometry, random_volume(), projector=projector).array, 2 * one, rtol=1e-6
        )


class TestExactPath:
    """The exact radiological path: the length of a ray in each voxel's box, one box at a time."""

    @staticmethod
    def by_boxes(volume, geometry):
        """Σ μ · length of the ray in the box, each box clipped on its own (slab method)."""
        points, directions = rays(geometry)
        total = np.zeros(points.shape[:-1])
        for (z, y, x), value in np.ndenumerate(volume.array):
            low = volume.origin + VOXEL * (np.array([x, y, z]) - 0.5)
            with np.errstate(divide="ignore", invalid="ignore"):
                first, second = (low - points) / directions, (low + VOXEL - points) / directions
            inside = (points >= low) & (points < low + VOXEL)
            parallel = directions == 0
            enter = np.where(parallel, np.where(inside, -np.inf, np.inf), np.minimum(first, second)).max(axis=-1)
            leave = np.where(parallel, np.inf, np.maximum(first, second)).min(axis=-1)
            total += value * np.maximum(leave - enter, 0)
        return total

    @every_geometry
    def test_equals_the_sum_over_boxes(self, geometry):
        volume = random_volume(3)
        expected = self.by_boxes(volume, geometry)
        computed = double_forward(pad(volume.array.astype(float)), geometry, "exact", padded_origin(volume))
        np.testing.assert_allclose(computed, expected, atol=1e-11)
        np.testing.assert_allclose(project(volume, geometry, projector="exact"), expected, atol=2e-5)

    def test_one_voxel_across_its_diagonal(self):
        geometry = Geometry(np.array([[1.0, 1, 1, 5, 5, 5, 1, -1, 0, 1, 1, -2]]), (1, 1), "parallel")
        value = project(Volume(np.full((1, 1, 1), 2.0), 0.5), geometry, projector="exact")
        np.testing.assert_allclose(value, 2 * 0.5 * np.sqrt(3), rtol=1e-6)

    def test_a_straight_ray_through_voxel_centres(self):
        """An axis-aligned ray through centres: both projectors read the row of voxels and nothing else."""
        volume = random_volume(4, (5, 6, 7))
        geometry = Geometry(np.array([[0, 1.0, 0, *CENTER, VOXEL, 0, 0, 0, 0, VOXEL]]), (5, 7), "parallel")
        for projector in PROJECTORS:
            np.testing.assert_allclose(
                project(volume, geometry, projector=projector)[0], volume.array.sum(axis=1) * VOXEL, rtol=1e-5
            )


class TestTrilinearPath:
    """The trilinear image, sampled where the ray meets the planes of voxel centres of its dominant axis."""

    @staticmethod
    def by_samples(volume, geometry):
        points, directions = rays(geometry)
        array = np.pad(volume.array.astype(float), 2)
        origin = volume.origin - 2 * VOXEL
        total = np.zeros(points.shape[:-1])
        for index in np.ndindex(total.shape):
            o, d = (points[index] - origin) / VOXEL, directions[index] / VOXEL
            a = np.argmax(np.abs(d))
            s = (np.arange(array.shape[2 - a]) - o[a]) / d[a]
            x = o + s[:, None] * d
            samples = ndimage.map_coordinates(array, x[:, ::-1].T, order=1, mode="constant")
            total[index] = samples.sum() / abs(d[a])
        return total

    @every_geometry
    def test_equals_the_sum_of_samples(self, geometry):
        volume = random_volume(5)
        expected = self.by_samples(volume, geometry)
        computed = double_forward(pad(volume.array.astype(float)), geometry, "trilinear", padded_origin(volume))
        np.testing.assert_allclose(computed, expected, atol=1e-11)
        np.testing.assert_allclose(project(volume, geometry, projector="trilinear"), expected, atol=2e-5)


class TestLinearity:
    @every_projector
    def test_projection_is_linear(self, projector):
        geometry = GEOMETRIES["cone, tilted"]
        a, b = random_volume(6), random_volume(7, negative=True)
        both = Volume(2 * a.array - 3 * b.array, VOXEL, CENTER)
        expected = 2 * project(a, geometry, projector=projector) - 3 * project(b, geometry, projector=projector)
        np.testing.assert_allclose(project(both, geometry, projector=projector), expected, atol=1e-5)

    @every_projector
    def test_mass_in_a_parallel_beam_is_the_same_from_every_side(self, projector):
        volume = random_volume(8, (6, 6, 6))
        geometry = Geometry.parallel([0, 30, 45, 90, 120], (200, 200), 0.01)
        masses = project(volume, geometry, projector=projector).sum(axis=(1, 2), dtype=float) * 0.01**2
        np.testing.assert_allclose(masses, volume.array.sum(dtype=float) * VOXEL**3, rtol=4e-3)


def exact_ball(voxel, center=(0.07, -0.11, 0.05), radius=1.0):
    """A ball without voxels, and its attenuation averaged over voxels."""
    sample = Sample((Particle(Ellipsoid(np.array(center), np.full(3, radius), np.eye(3)), 1.0),))
    n = int(np.ceil(2.6 * radius / voxel))
    return sample, attenuation_volume(sample, Volume.zeros((n, n, n), voxel), samples=5)


class TestKnownBodies:
    @pytest.mark.parametrize("beam", ["cone", "parallel"])
    def test_ball_and_ellipsoid_converge_with_the_voxel_size(self, beam):
        rotation = rotation_matrix([0.3, -0.5, 0.8])
        body = Ellipsoid(np.array([0.1, -0.05, 0.08]), np.array([0.6, 0.8, 1.0]), rotation)
        sample = Sample((Particle(body, 1.5),))
        if beam == "cone":
            geometry = Geometry.cone(
                [0.0, 40.0], (24, 26), 0.25, source_to_axis=10, source_to_detector=25, panel=TILTED
            )
        else:
            geometry = Geometry.parallel([0.0, 40.0], (24, 26), 0.1, panel=TILTED)
        points, directions = rays(geometry)
        # chord of an ellipsoid, by the quadratic formula in its own axes
        o, d = (points - body.center) @ rotation / body.semi_axes, directions @ rotation / body.semi_axes
        a, b, c = (d * d).sum(-1), (o * d).sum(-1), (o * o).sum(-1) - 1
        chords = 1.5 * 2 * np.sqrt(np.maximum(b * b - a * c, 0)) / a
        np.testing.assert_allclose(line_integrals(sample, geometry, subsamples=1), chords, atol=2e-6)
        errors = {}
        for n in (14, 28, 56):
            volume = attenuation_volume(sample, Volume.zeros((n, n, n), 2.4 / n), samples=3)
            for projector in PROJECTORS:
                difference = project(volume, geometry, projector=projector) - chords
                errors[projector, n] = np.sqrt((difference**2).mean()) / chords.max()
        for projector in PROJECTORS:
            assert errors[projector, 14] > 1.6 * errors[projector, 28] > 1.6**2 * errors[projector, 56]
            assert errors[projector, 56] < 0.015

    def test_magnified_projection_of_a_ball(self):
        """The brightest pixel is the ball's centre and its value the diameter."""
        _, volume = exact_ball(0.1)
        geometry = Geometry.cone([30.0], (61, 61), 0.05, source_to_axis=10, source_to_detector=20)
        for projector in PROJECTORS:
            image = project(volume, geometry, projector=projector)[0]
            row, column = geometry.project_points([0.07, -0.11, 0.05])[0, 0]
            assert image.max() == pytest.approx(2.0, rel=0.02)
            assert image[round(row), round(column)] == pytest.approx(2.0, rel=0.02)


# ---------------------------------------------------------------------- moving grains
def two_grains(seed=10):
    """Two irregular touching grains side by side, their set and the volume they fill."""
    rng = np.random.default_rng(seed)
    array = ndimage.gaussian_filter(rng.uniform(0, 1, (9, 10, 16)), 0.7).astype(np.float32)
    labels = np.zeros(array.shape, np.int32)
    labels[1:8, 1:9, 1:8], labels[2:9, 2:9, 8:15] = 1, 2
    labels[3:5, 4:6, 8] = 1
    volume = Volume(np.where(labels > 0, array, 0), 0.1, (0.05, 0.1, -0.08))
    return grains_from_labels(volume, labels, reach=0, finer=1), volume


def double_project(packed, pose, geometry, patches, projector, derivatives=False):
    """The grains' kernels in double precision."""
    grains = packed.table(pose)._replace(voxels=packed.images.astype(float))
    views = ViewTable(geometry.vectors, geometry.beam == "cone", np.array(geometry.shape))
    tables = grains, views, patches.table, projector == "exact"
    return CPU.project_with_derivatives(*tables) if derivatives else CPU.project(*tables)


POSE = Pose(
    np.array([[0.03, -0.05, 0.02], [-0.02, 0.04, -0.06]]),
    rotation_matrix([[0.2, -0.4, 0.3], [-1.0, 0.5, 2.0]]),
)


class TestDerivatives:
    @every_geometry
    @every_projector
    def test_central_finite_differences(self, geometry, projector):
        grains, _ = two_grains()
        packed = GrainArrays.of(grains)
        patches = footprint_patches(packed, POSE, geometry)
        values, derivative_images = double_project(packed, POSE, geometry, patches, projector, derivatives=True)
        np.testing.assert_allclose(values, double_project(packed, POSE, geometry, patches, projector), atol=1e-12)
        assert np.abs(derivative_images).max(axis=1).min() > 0.1
        step = 1e-7
        for k in range(6):
            increment = step * np.eye(6)[k]
            ends = [
                double_project(
                    packed,
                    Pose(
                        POSE.translations + sign * increment[:3],
                        rotation_matrix(sign * increment[3:]) @ POSE.matrices,
                    ),
                    geometry,
                    patches,
                    projector,
                )
                for sign in (1, -1)
            ]
            difference = (ends[0] - ends[1]) / (2 * step)
            # a few samples may cross a voxel's border within the step: there the derivative has a jump
            wrong = np.abs(difference - derivative_images[k]) > 1e-6 * np.abs(derivative_images[k]).max()
            assert wrong.mean() < 2e-3
            assert np.abs(difference).max() > 0

    @every_projector
    def test_single_precision_and_the_papers_differences(self, projector):
        geometry = GEOMETRIES["cone"]
        grains, _ = two_grains()
        packed = GrainArrays.of(grains)
        patches = footprint_patches(packed, POSE, geometry)
        exact_values, exact = double_project(packed, POSE, geometry, patches, projector, derivatives=True)
        values, derivative_images = differentiate_patches(packed, POSE, geometry, patches, projector)
        np.testing.assert_allclose(values, exact_values, atol=3e-6)
        differences = difference_patches(packed, POSE, geometry, patches, projector)[1].derivatives
        for k in range(6):
            scale = np.sqrt((exact[k] ** 2).mean())
            assert np.sqrt(((derivative_images[k] - exact[k]) ** 2).mean()) < 1e-4 * scale
            assert (
                np.sqrt(((differences[k] - exact[k]) ** 2).mean()) < (0.05 if projector == "trilinear" else 0.3) * scale
            )  # boxes have corners

    @every_geometry
    @every_projector
    def test_derivatives_along_and_about_a_ray_are_zero(self, geometry, projector):
        """A grain that slides along a ray, or rotates about it, keeps that ray's line integral."""
        grains, _ = two_grains()
        packed = GrainArrays.of(grains)
        patches = footprint_patches(packed, POSE, geometry)
        values, derivative_images = double_project(packed, POSE, geometry, patches, projector, derivatives=True)
        points, directions = rays(geometry)
        for p, (g, i, r0, r1, c0, c1) in enumerate(patches.boxes):
            own = slice(patches.offsets[p], patches.offsets[p + 1])
            e = directions[i, r0:r1, c0:c1].reshape(-1, 3)
            away = (packed.centers + POSE.translations)[g] - points[i, r0:r1, c0:c1].reshape(-1, 3)
            by_u, by_rotation = derivative_images[:3, own].T, derivative_images[3:, own].T
            scale = np.abs(by_u).max()
            np.testing.assert_allclose((by_u * e).sum(-1), 0, atol=1e-11 * scale)
            about_ray = (by_rotation * e).sum(-1) + (by_u * np.cross(e, away)).sum(-1)
            np.testing.assert_allclose(about_ray, 0, atol=1e-10 * scale)
        assert values.max() > 0.1


class TestPatches:
    @every_geometry
    @every_projector
    def test_unmoved_grains_sum_to_the_projection_of_the_volume(self, geometry, projector):
        grains, volume = two_grains()
        still = Motions.identity(grains.labels, grains.centers)
        np.testing.assert_allclose(
            simulate_radiographs(grains, still, geometry, projector=projector),
            project(volume, geometry, projector=projector),
            atol=3e-6,
        )

    @every_projector
    @pytest.mark.parametrize("pixel", [0.005, 0.02, 0.1, 0.4], ids="pixel {} mm".format)
    def test_projection_at_any_pixel_size(self, projector, pixel):
        """Voxels of 0.1 mm on pixels from 20 times finer to 4 times coarser: nothing is cut off at the edges."""
        grains, volume = two_grains()
        across = int(np.ceil(2.6 / pixel))
        leaning = DetectorAlignment(axis_tilt_deg=(35, 20))  # so that corners of voxels reach furthest
        geometry = Geometry.parallel([20.0, 45.0, 70.0], (across, across), pixel, panel=leaning)
        still = Motions.identity(grains.labels, grains.centers)
        np.testing.assert_allclose(
            simulate_radiographs(grains, still, geometry, projector=projector),
            project(volume, geometry, projector=projector),
            atol=3e-6,
        )

    @every_projector
    @pytest.mark.parametrize("elongated", [False, True])
    def test_projection_of_large_grains(self, projector, elongated):
        """120 voxels across: the hull that bounds the footprint must not cut off its edge."""
        n = 124
        z, y, x = np.meshgrid(*[np.arange(n) - (n - 1) / 2] * 3, indexing="ij")
        square = (x + y) ** 2 / 2 + (x - y) ** 2 / 2 * (36 if elongated else 1) + z**2
        volume = Volume((square < 60**2).astype(np.float32), 0.1)
        grains = grains_from_labels(volume, (volume.array > 0).astype(np.int8), reach=0, finer=1)
        geometry = Geometry.cone([11.0, 52.0], (150, 150), 0.2, source_to_axis=60, source_to_detector=120)
        still = Motions.identity(grains.labels, grains.centers)
        whole = project(volume, geometry, projector=projector)
        np.testing.assert_allclose(simulate_radiographs(grains, still, geometry, projector=projector), whole, atol=2e-4)

    @every_projector
    def test_a_background_is_added(self, projector):
        grains, volume = two_grains()
        background = random_volume(11)
        geometry = GEOMETRIES["cone"]
        still = Motions.identity(grains.labels, grains.centers)
        np.testing.assert_allclose(
            simulate_radiographs(GrainSet(grains.grains, one_body(background)), still, geometry, projector=projector),
            project(volume, geometry, projector=projector) + project(background, geometry, projector=projector),
            atol=5e-6,
        )

    @every_projector
    def test_the_whole_sample_moved_is_the_views_moved_back(self, projector):
        """x = Ω X + t for every grain, seen from a source and panel that move along, changes nothing."""
        grains, volume = two_grains()
        rotation, shift = rotation_matrix([0.4, -0.7, 1.1]), np.array([0.3, -0.2, 0.5])
        moved = apply_motion(rotation, shift, np.zeros(3), grains.centers)
        motions = Motions.identity(grains.labels, grains.centers)
        motions.translations[:] = moved - grains.centers
        motions.rotations[:] = rotation_vector(rotation)
        for name in ("cone, tilted", "parallel, tilted"):
            geometry = GEOMETRIES[name]
            rows = geometry.vectors.reshape(-1, 4, 3) @ rotation.T
            rows[:, 1] += shift
            if geometry.beam == "cone":
                rows[:, 0] += shift
            along = Geometry(rows.reshape(-1, 12), PANEL, geometry.beam)
            np.testing.assert_allclose(
                simulate_radiographs(grains, motions, along, projector=projector),
                project(volume, geometry, projector=projector),
                atol=1e-5,
            )

    @pytest.mark.parametrize("axis", [0, 1, 2], ids="xyz")
    @every_projector
    def test_a_quarter_rotation_is_that_of_the_array(self, projector, axis):
        """Rotating the grain by +90° about x, y or z is rotating its voxels, y→z, z→x or x→y."""
        array = random_volume(12, (5, 5, 5)).array
        first, second = [(1, 2), (2, 0), (0, 1)][axis]  # the rotation carries the first to the second axis, x y z
        rotated = np.rot90(array, axes=(2 - first, 2 - second))
        grains = grains_from_labels(Volume(array, 0.1, (0.1, 0.2, 0.3)), np.ones((5, 5, 5), np.int8), reach=0, finer=1)
        motions = Motions.identity(grains.labels, np.array([[0.1, 0.2, 0.3]]))  # not the centre of mass
        motions.rotations[0, axis] = np.pi / 2
        geometry = GEOMETRIES["cone, tilted"]
        np.testing.assert_allclose(
            simulate_radiographs(grains, motions, geometry, projector=projector),
            project(Volume(rotated, 0.1, (0.1, 0.2, 0.3)), geometry, projector=projector),
            atol=1e-5,
        )

    @pytest.mark.parametrize("name", ["cone, tilted", "parallel, tilted"])
    @every_projector
    def test_a_shift_moves_the_projection_as_project_points_says(self, projector, name):
        _, volume = exact_ball(0.02, (0.0, 0.0, 0.0), 0.1)
        grains = grains_from_labels(volume, (volume.array > 0).astype(np.int8), reach=0)
        wide = GEOMETRIES[name]
        geometry = Geometry(wide.vectors * np.array([1] * 6 + [0.25] * 6), (60, 70), wide.beam)
        rows, columns = np.mgrid[:60, :70]
        for shift in ([0, 0, 0], [0.2, 0, 0], [0, 0.2, 0], [0, 0, 0.2], [-0.1, 0.15, -0.2]):
            motions = Motions.identity(grains.labels, grains.centers)
            motions.translations[:] = shift
            images = simulate_radiographs(grains, motions, geometry, projector=projector).astype(float)
            mass = images.sum(axis=(1, 2))
            centroids = np.stack([(images * k).sum(axis=(1, 2)) / mass for k in (rows, columns)], axis=1)
            expected = geometry.project_points(grains.centers[0] + shift)[:, 0]
            np.testing.assert_allclose(centroids, expected, atol=0.1)  # pixels
