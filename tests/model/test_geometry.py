"""Geometry (`model.geometry`): where points of the sample project on the panel, with every sign; refused input."""

import pickle

import numpy as np
import pytest

from grainmotion.errors import InputError
from grainmotion.model.detector_alignment import DetectorAlignment
from grainmotion.model.geometry import Geometry
from grainmotion.rotations import rotation_matrix

SOURCE_TO_AXIS, SOURCE_TO_DETECTOR, PIXEL = 100.0, 400.0, 0.5
MAGNIFICATION = SOURCE_TO_DETECTOR / SOURCE_TO_AXIS
SHAPE = (40, 60)
MIDDLE = np.array([19.5, 29.5])  # row, column of the geometric centre of 40 × 60 pixels
BEAMS = ("cone", "parallel")


def circular(beam="cone", angles=(0.0,), shape=SHAPE, panel=None, pixel=PIXEL):
    if beam == "parallel":
        return Geometry.parallel(angles, shape, pixel, panel=panel)
    return Geometry.cone(
        angles, shape, pixel, source_to_axis=SOURCE_TO_AXIS, source_to_detector=SOURCE_TO_DETECTOR, panel=panel
    )


def projected(geometry, point, view=0):
    """Row and column to which a point projects."""
    return geometry.project_points(point)[view, 0]


class TestPerfectAlignment:
    @pytest.mark.parametrize("beam", BEAMS)
    @pytest.mark.parametrize("shape", [(40, 60), (41, 61), (41, 60), (1, 1)], ids=str)
    def test_the_axis_projects_to_the_panel_s_centre(self, beam, shape):
        """Between two pixels when their number is even, on one when it is odd."""
        geometry = circular(beam, [0.0, 77.0], shape)
        np.testing.assert_allclose(
            geometry.project_points([0, 0, 0])[:, 0], [((shape[0] - 1) / 2, (shape[1] - 1) / 2)] * 2
        )
        # the same from the positions of the pixels: their mean is the panel's centre
        pixels = geometry.pixel_positions(1)
        assert pixels.shape == (*shape, 3)
        np.testing.assert_allclose(pixels.mean(axis=(0, 1)), geometry.vectors[1, 3:6], atol=1e-9)

    @pytest.mark.parametrize(("beam", "magnification"), [("cone", MAGNIFICATION), ("parallel", 1.0)])
    def test_x_is_along_columns_and_z_along_rows_magnified(self, beam, magnification):
        geometry = circular(beam)
        np.testing.assert_allclose(projected(geometry, [1, 0, 0]) - MIDDLE, [0, magnification / PIXEL])
        np.testing.assert_allclose(projected(geometry, [0, 0, 1]) - MIDDLE, [magnification / PIXEL, 0])
        assert geometry.pixel_at([0, 0, 0]) == pytest.approx(PIXEL / magnification)

    def test_a_point_nearer_to_the_source_is_magnified_more(self):
        geometry = circular()
        np.testing.assert_allclose(projected(geometry, [1, -20, 0]) - MIDDLE, [0, 400 / 80 / PIXEL])
        assert geometry.pixel_at([0, -20, 0]) == pytest.approx(PIXEL * 80 / 400)

    def test_a_point_on_the_right_comes_nearer_to_the_source_as_the_angle_grows(self):
        geometry = circular(angles=[0.0, 30.0, 90.0])
        distances = np.linalg.norm(geometry.vectors[:, :3] - [5.0, 0, 0], axis=1)
        assert distances[0] > distances[1] > distances[2]
        columns = geometry.project_points([5.0, 0, 0])[:, 0, 1]
        assert columns[0] > columns[1] > columns[2] == pytest.approx(MIDDLE[1])

    @pytest.mark.parametrize("beam", BEAMS)
    def test_rotating_the_views_is_rotating_the_sample_backwards(self, beam):
        points = np.random.default_rng(0).uniform(-8, 8, (20, 3))
        rotated = points @ rotation_matrix([0, 0, np.deg2rad(-37)]).T
        pixels = circular(beam, [37.0]).project_points(points)
        np.testing.assert_allclose(pixels, circular(beam, [0.0]).project_points(rotated))

    @pytest.mark.parametrize("beam", BEAMS)
    def test_a_rotation_by_180_degrees_mirrors_the_columns(self, beam):
        pixels = circular(beam, [0.0, 180.0]).project_points([[3, 0, 2]])[:, 0]
        np.testing.assert_allclose(pixels[0] - MIDDLE, (pixels[1] - MIDDLE) * [1, -1])


class TestDetectorAlignment:
    """Each misalignment, as the displacement of a feature on the radiograph."""

    @pytest.mark.parametrize("beam", BEAMS)
    def test_offset_moves_features_to_lower_columns_and_rows(self, beam):
        moved = projected(circular(beam, panel=DetectorAlignment(detector_offset=(1.5, -2.0))), [0, 0, 0]) - MIDDLE
        np.testing.assert_allclose(moved, [2.0 / PIXEL, -1.5 / PIXEL], atol=1e-12)

    def test_offset_follows_the_rows_when_they_run_down(self):
        moved = (
            projected(circular(panel=DetectorAlignment(detector_offset=(0, 2.0), first_row="top")), [0, 0, 0]) - MIDDLE
        )
        np.testing.assert_allclose(moved, [-2.0 / PIXEL, 0], atol=1e-12)

    @pytest.mark.parametrize("beam", BEAMS)
    def test_first_row_at_the_top_or_bottom(self, beam):
        assert projected(circular(beam), [0, 0, 1])[0] > MIDDLE[0]
        top = circular(beam, panel=DetectorAlignment(first_row="top"))
        assert projected(top, [0, 0, 1])[0] < MIDDLE[0]
        np.testing.assert_allclose(projected(top, [1, 0, 0]), projected(circular(beam), [1, 0, 0]))

    def test_pitch_brings_the_upper_edge_nearer_to_the_source(self):
        """A positive rotation about x tips z towards −y: features above the centre approach it."""
        geometry = circular(panel=DetectorAlignment(detector_tilts_deg=(10.0, 0, 0)))
        upper, lower = geometry.pixel_positions(0)[[-1, 0], 30]
        assert upper[1] < lower[1]  # row 39 is the upper one; it is nearer to the source
        above, below = projected(geometry, [0, 0, 2]) - MIDDLE, MIDDLE - projected(geometry, [0, 0, -2])
        assert 0 < above[0] < below[0]

    def test_in_plane_rotation(self):
        """A positive rotation about the beam (+y) moves +x to −z: features to the right appear higher."""
        geometry = circular(panel=DetectorAlignment(detector_tilts_deg=(0, 5.0, 0)))
        assert geometry.vectors[0, 8] < 0
        right = projected(geometry, [2, 0, 0]) - MIDDLE
        angle = np.deg2rad(5)
        np.testing.assert_allclose(right, 2 * MAGNIFICATION / PIXEL * np.array([np.sin(angle), np.cos(angle)]))

    def test_yaw_takes_the_right_columns_away_from_the_source(self):
        geometry = circular(panel=DetectorAlignment(detector_tilts_deg=(0, 0, 10.0)))
        left, right = geometry.pixel_positions(0)[20, [0, -1]]
        assert right[1] > left[1]
        to_the_right, to_the_left = projected(geometry, [2, 0, 0]) - MIDDLE, MIDDLE - projected(geometry, [-2, 0, 0])
        assert to_the_right[1] > to_the_left[1] > 0

    @pytest.mark.parametrize(("beam", "magnification"), [("cone", MAGNIFICATION), ("parallel", 1.0)])
    def test_axis_offset_moves_features_to_the_right_at_every_angle(self, beam, magnification):
        geometry = circular(beam, [0.0, 63.0, 250.0], panel=DetectorAlignment(axis_offset=0.7))
        moved = geometry.project_points([0, 0, 0])[:, 0] - MIDDLE
        np.testing.assert_allclose(moved, [[0, 0.7 * magnification / PIXEL]] * 3, atol=1e-9)

    def test_axis_tilt_about_the_beam_tilts_the_axis_on_the_radiograph(self):
        """A positive angle about y (the beam) tilts z to +x: the axis appears further right at the top."""
        geometry = circular(angles=[0.0, 110.0], panel=DetectorAlignment(axis_tilt_deg=(0.0, 3.0)))
        low, middle, high = (geometry.project_points([0, 0, z])[:, 0] - MIDDLE for z in (-3, 0, 3))
        np.testing.assert_allclose(middle, 0, atol=1e-9)
        tangent = np.tan(np.deg2rad(3))
        for offset in (high, -low):  # the same at every angle, because the axis does not move
            np.testing.assert_allclose(offset[:, 1] / offset[:, 0], tangent)
            assert (offset[:, 1] > 0).all()

    def test_axis_tilt_about_x_tilts_the_axis_towards_the_source(self):
        geometry = circular(panel=DetectorAlignment(axis_tilt_deg=(4.0, 0.0)))
        high, low = projected(geometry, [0, 0, 3]) - MIDDLE, MIDDLE - projected(geometry, [0, 0, -3])
        assert high[1] == pytest.approx(0)
        assert high[0] > low[0] > 0  # +z tilts to −y, nearer to the source, and is magnified more

    @pytest.mark.parametrize("name", ["Top", "upper", ""])
    def test_unknown_first_row_is_refused(self, name):
        with pytest.raises(InputError, match=r"first_row.*bottom"):
            DetectorAlignment(first_row=name)


class TestMisalignedByHand:
    """All misalignments at once, against a ray–plane intersection in the laboratory frame."""

    PANEL = DetectorAlignment(
        detector_offset=(1.3, -0.8),
        detector_tilts_deg=(2.0, -3.0, 5.0),
        axis_offset=0.6,
        axis_tilt_deg=(1.5, -2.5),
        first_row="top",
    )

    @staticmethod
    def rotation(vector_deg):
        """Rodrigues' formula."""
        w = np.deg2rad(np.asarray(vector_deg, dtype=float))
        angle = np.linalg.norm(w)
        k = w / angle
        K = np.array([[0, -k[2], k[1]], [k[2], 0, -k[0]], [-k[1], k[0], 0]])
        return np.eye(3) + np.sin(angle) * K + (1 - np.cos(angle)) * K @ K

    def by_hand(self, beam, angle, point):
        """The sample rotates by −θ, then is tilted and offset with the axis; source and panel are fixed."""
        point = self.rotation([0, 0, -angle]) @ point
        point = self.rotation([1.5, -2.5, 0]) @ point + [0.6, 0, 0]
        rotation = self.rotation([2.0, -3.0, 5.0])
        u, v = rotation @ [PIXEL, 0, 0], rotation @ [0, 0, -PIXEL]
        distance = SOURCE_TO_DETECTOR - SOURCE_TO_AXIS if beam == "cone" else 0.0
        center = np.array([0, distance, 0]) + 1.3 * u / PIXEL - 0.8 * v / PIXEL
        source = np.array([0, -SOURCE_TO_AXIS, 0])
        ray = point - source if beam == "cone" else np.array([0.0, 1.0, 0.0])
        # point + t ray = center + a u + b v
        _, a, b = np.linalg.solve(np.column_stack([-ray, u, v]), point - center)
        return np.array([(SHAPE[0] - 1) / 2 + b, (SHAPE[1] - 1) / 2 + a])

    @pytest.mark.parametrize("beam", BEAMS)
    def test_projected_points_equal_ray_plane_intersections(self, beam):
        angles = [20.0, 143.0, -71.0]
        geometry = circular(beam, angles, panel=self.PANEL)
        points = np.random.default_rng(2).uniform(-4, 4, (6, 3))
        pixels = geometry.project_points(points)
        assert pixels.shape == (3, 6, 2)
        for i, angle in enumerate(angles):
            for k, point in enumerate(points):
                np.testing.assert_allclose(pixels[i, k], self.by_hand(beam, angle, point), atol=1e-9)

    @pytest.mark.parametrize("beam", BEAMS)
    def test_pixels_project_onto_themselves(self, beam):
        geometry = circular(beam, [0.0, 200.0], panel=self.PANEL)
        pixels = geometry.pixel_positions(1)
        if beam == "cone":  # any point on the ray
            pixels = 0.3 * pixels + 0.7 * geometry.vectors[1, :3]
        rows, columns = np.mgrid[:40, :60]
        projected_pixels = geometry.project_points(pixels)[1].reshape(40, 60, 2)
        np.testing.assert_allclose(projected_pixels, np.stack([rows, columns], -1), atol=1e-9)

    def test_skewed_and_anisotropic_pixels(self):
        """u and v need be neither orthogonal nor of one length."""
        row = [0, -100, 0, 3, 300, 2, 0.5, 0.01, 0.02, 0.1, 0, 0.25]
        geometry = Geometry(np.array([row]), (7, 9))
        rows, columns = np.mgrid[:7, :9]
        projected_pixels = geometry.project_points(geometry.pixel_positions(0))[0].reshape(7, 9, 2)
        np.testing.assert_allclose(projected_pixels, np.stack([rows, columns], -1), atol=1e-9)
        np.testing.assert_allclose(geometry.pixel_sizes, [[np.hypot(0.1, 0.25), np.linalg.norm([0.5, 0.01, 0.02])]])


class TestProjectPoints:
    def test_only_points_behind_the_source_are_nan(self):
        pixels = circular().project_points([[0, -99.0, 0], [0, -100.0, 0], [0, -101.0, 0]])[0]
        assert np.isfinite(pixels[0]).all()
        assert np.isnan(pixels[1:]).all()

    def test_in_a_parallel_beam_every_point_projects(self):
        assert np.isfinite(circular("parallel").project_points([[0, -1e6, 0], [0, 1e6, 0]])).all()

    def test_ray_direction_may_have_any_length_and_sign(self):
        geometry = circular("parallel", [33.0])
        vectors = geometry.vectors.copy()
        vectors[:, :3] *= -7
        points = np.random.default_rng(3).normal(size=(5, 3))
        np.testing.assert_allclose(
            Geometry(vectors, SHAPE, "parallel").project_points(points), geometry.project_points(points)
        )


class TestAstra:
    """The formulae by which ASTRA's ``geom_2vec`` converts its ``cone`` and ``parallel3d`` geometries."""

    ANGLES = np.deg2rad([0.0, 17.0, 90.0, 201.0])

    def test_cone_beam_equals_astra_s_cone_vec(self):
        geometry = circular(angles=np.rad2deg(self.ANGLES))
        for row, angle in zip(geometry.to_astra()["Vectors"], self.ANGLES, strict=True):
            sin, cos = np.sin(angle), np.cos(angle)
            origin_source, origin_detector = SOURCE_TO_AXIS, SOURCE_TO_DETECTOR - SOURCE_TO_AXIS
            expected = [
                sin * origin_source, -cos * origin_source, 0,
                -sin * origin_detector, cos * origin_detector, 0,
                cos * PIXEL, sin * PIXEL, 0,
                0, 0, PIXEL,
            ]  # fmt: skip
            np.testing.assert_allclose(row, expected, atol=1e-12)

    def test_parallel_beam_equals_astra_s_parallel3d_vec(self):
        """ASTRA's direction (sin θ, −cos θ, 0) points against ours; the lines are the same."""
        ours = circular("parallel", np.rad2deg(self.ANGLES))
        sin, cos, zero = np.sin(self.ANGLES), np.cos(self.ANGLES), np.zeros(4)
        rows = np.stack(
            [sin, -cos, zero, zero, zero, zero, cos * PIXEL, sin * PIXEL, zero, zero, zero, zero + PIXEL], axis=1
        )
        theirs = Geometry.from_astra(
            {"type": "parallel3d_vec", "DetectorRowCount": 40, "DetectorColCount": 60, "Vectors": rows}
        )
        np.testing.assert_allclose(ours.vectors[:, 3:], theirs.vectors[:, 3:], atol=1e-12)
        np.testing.assert_allclose(ours.vectors[:, :3], -theirs.vectors[:, :3], atol=1e-12)
        points = np.random.default_rng(4).normal(size=(5, 3))
        np.testing.assert_allclose(ours.project_points(points), theirs.project_points(points))

    @pytest.mark.parametrize(("beam", "kind"), [("cone", "cone_vec"), ("parallel", "parallel3d_vec")])
    def test_conversion_to_astra_and_back(self, beam, kind):
        geometry = circular(beam, [1.0, 2.0], panel=TestMisalignedByHand.PANEL)
        given = geometry.to_astra()
        assert (given["type"], given["DetectorRowCount"], given["DetectorColCount"]) == (kind, *SHAPE)
        back = Geometry.from_astra(given)
        np.testing.assert_array_equal(back.vectors, geometry.vectors)
        assert (back.beam, back.shape) == (beam, SHAPE)
        given["Vectors"][:] = 0  # a copy: the geometry is not touched
        assert geometry.vectors.any()

    def test_circular_astra_geometries_are_refused(self):
        with pytest.raises(InputError, match=r"type 'cone'.*geom_2vec"):
            Geometry.from_astra({"type": "cone"})


class TestParts:
    @pytest.mark.parametrize("beam", BEAMS)
    def test_parts_are_the_columns_of_the_vectors(self, beam):
        geometry = circular(beam, [0.0, 50.0])
        parts = (geometry.source, geometry.detector, geometry.u, geometry.v)
        np.testing.assert_array_equal(np.hstack(parts), geometry.vectors)

    def test_rays_run_from_the_source_to_the_panel(self):
        cone, parallel = (circular(beam, [0.0]) for beam in BEAMS)
        np.testing.assert_allclose(cone.rays, [[0, SOURCE_TO_DETECTOR, 0]], atol=1e-12)
        np.testing.assert_allclose(parallel.rays, parallel.source)
        np.testing.assert_allclose(cone.normals, [[0, -(PIXEL**2), 0]], atol=1e-12)

    @pytest.mark.parametrize("beam", BEAMS)
    def test_azimuths_are_the_angles_of_the_scan(self, beam):
        np.testing.assert_allclose(circular(beam, [0.0, 30.0, 200.0, -1.0]).azimuths_deg, [0, 30, 200, 359])


class TestSelection:
    def test_views_in_the_order_asked_for(self):
        geometry = circular(angles=[0.0, 10.0, 20.0, 30.0])
        np.testing.assert_array_equal(geometry[[3, 1]].vectors, geometry.vectors[[3, 1]])
        np.testing.assert_array_equal(geometry[1:3].vectors, geometry.vectors[1:3])
        np.testing.assert_array_equal(geometry[-1].vectors, geometry.vectors[3:])
        assert len(geometry[np.array([True, False, True, False])]) == 2
        assert "2 views of 40 × 60" in repr(geometry[:2])

    def test_views_cannot_be_changed(self):
        geometry = circular()
        with pytest.raises(ValueError, match="read-only"):
            geometry.vectors[0, 0] = 1


def changed(**columns):
    """A valid row with some of its numbers replaced."""
    row = np.array([0.0, -100, 0, 0, 300, 0, 0.5, 0, 0, 0, 0, 0.5])
    names = ("sx", "sy", "sz", "dx", "dy", "dz", "ux", "uy", "uz", "vx", "vy", "vz")
    for name, value in columns.items():
        row[names.index(name)] = value
    return np.stack([changed(), row]) if columns else row


class TestRefused:
    @pytest.mark.filterwarnings("error")
    @pytest.mark.parametrize(
        ("vectors", "fact"),
        [
            (changed(sx=np.nan), r"view 1 \(row 2\): it holds NaN"),
            (changed(vz=np.inf), r"view 1 \(row 2\): it holds NaN or infinity"),
            (changed(ux=0), "u or v has zero length"),
            (changed(vz=0), "u or v has zero length"),
            (changed(vx=1, vz=0), "u and v are parallel"),
            (changed(vx=-0.5, vz=1e-9), "u and v are parallel"),
            (changed(sy=300), "the rays run inside the panel's plane"),
            (changed(sx=50, sy=300), "the rays run inside the panel's plane"),
            (np.zeros((0, 12)), "not \\(views, 12\\)"),
            (np.zeros((3, 11)), "not \\(views, 12\\)"),
            (np.zeros((1, 2, 12)), "not \\(views, 12\\)"),
        ],
    )
    @pytest.mark.filterwarnings("error")
    def test_invalid_views(self, vectors, fact):
        with pytest.raises(InputError, match=fact):
            Geometry(vectors, SHAPE)

    @pytest.mark.parametrize("direction", [(0, 0, 0), (1, 0, 0), (0.3, 0, -2)])
    def test_parallel_rays_inside_the_panel(self, direction):
        rows = changed(sx=direction[0], sy=direction[1], sz=direction[2])[1:]
        with pytest.raises(InputError, match="the rays run inside the panel's plane"):
            Geometry(rows, SHAPE, "parallel")

    def test_one_view_given_as_a_row(self):
        assert len(Geometry(changed(), SHAPE)) == 1

    @pytest.mark.parametrize("shape", [(0, 5), (5, 0), (-1, 5)])
    def test_panel_without_pixels(self, shape):
        with pytest.raises(InputError, match=r"panel of .* rows and columns"):
            Geometry(changed(), shape)

    def test_an_unknown_beam(self):
        with pytest.raises(InputError, match='\'fan\' is unknown; use "cone" or "parallel"'):
            Geometry(changed(), SHAPE, "fan")

    @pytest.mark.parametrize(("axis", "detector"), [(100, 100), (500, 400), (0, 400), (-1, 400), (np.nan, 400)])
    def test_impossible_distances(self, axis, detector):
        with pytest.raises(InputError, match="is not between 0 and source_to_detector"):
            Geometry.cone([0.0], SHAPE, PIXEL, source_to_axis=axis, source_to_detector=detector)

    @pytest.mark.parametrize("beam", BEAMS)
    @pytest.mark.parametrize("pixel", [0, -0.1, np.nan])
    def test_pixel_sizes_that_are_not_positive(self, beam, pixel):
        with pytest.raises(InputError, match=r"pixel_size.*must be > 0"):
            circular(beam, pixel=pixel)

    @pytest.mark.parametrize("beam", BEAMS)
    @pytest.mark.parametrize("angles", [[0, np.nan], [np.inf], [[0, 1]]])
    def test_angles_that_are_not_finite_numbers(self, beam, angles):
        with pytest.raises(InputError, match=r"angles_deg.*not a list of finite numbers"):
            circular(beam, angles)

    @pytest.mark.parametrize("beam", BEAMS)
    def test_no_angles(self, beam):
        with pytest.raises(InputError):
            circular(beam, [])

    @pytest.mark.parametrize(
        "field", [{"detector_offset": (np.nan, 0)}, {"axis_offset": np.inf}, {"detector_tilts_deg": (0, np.nan, 0)}]
    )
    def test_alignment_with_nan(self, field):
        with pytest.raises(InputError, match="NaN"):
            circular(panel=DetectorAlignment(**field))

    def test_panel_parallel_to_the_rays(self):
        with pytest.raises(InputError, match="the rays run inside the panel's plane"):
            circular(panel=DetectorAlignment(detector_tilts_deg=(0, 0, 90.0)))


class TestWindowAndBinning:
    POINTS = np.array([[0.3, -2.0, 1.1], [-4.0, 1.0, 2.5]])

    @pytest.mark.parametrize("beam", BEAMS)
    @pytest.mark.parametrize(("first", "shape"), [((3, 5), (10, 11)), ((-4, -7), (51, 80))], ids=["cut", "widened"])
    def test_pixels_of_a_window_are_counted_from_its_first(self, beam, first, shape):
        whole = circular(
            beam, [10.0, 80.0], panel=DetectorAlignment(detector_offset=(0.4, -0.2), detector_tilts_deg=(1.0, 2.0, 3.0))
        )
        part = whole.window(first, shape)
        assert part.shape == shape
        np.testing.assert_allclose(part.project_points(self.POINTS), whole.project_points(self.POINTS) - first)

    @pytest.mark.parametrize("beam", BEAMS)
    def test_a_binned_pixel_is_at_the_mean_of_its_pixels(self, beam):
        whole = circular(beam, [10.0, 80.0], panel=DetectorAlignment(detector_offset=(0.4, -0.2)))
        binned = whole.binned(4)
        assert binned.shape == (10, 15)
        np.testing.assert_allclose(binned.project_points(self.POINTS), (whole.project_points(self.POINTS) - 1.5) / 4)

    def test_a_factor_that_does_not_divide_the_panel(self):
        with pytest.raises(InputError, match="divide by 7"):
            circular().binned(7)


def test_vectors_of_a_table_are_stored_row_by_row():
    """As all others: a kernel that gets them in another order is compiled again."""
    vectors = np.asfortranarray(circular(angles=(0.0, 30.0)).vectors)
    geometry = Geometry(vectors, SHAPE)
    assert geometry.vectors.flags.c_contiguous
    np.testing.assert_array_equal(geometry.vectors, vectors)


def test_a_pickled_geometry_is_as_fixed():
    """Else kernels would be compiled for it once more."""
    geometry = pickle.loads(pickle.dumps(Geometry.cone((0.0,), (4, 4), 1.0, source_to_axis=10, source_to_detector=20)))
    assert not geometry.vectors.flags.writeable
