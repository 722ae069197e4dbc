"""SART on ellipsoids whose line integrals are known exactly, not by our projector."""

from functools import cache

import numpy as np
import pytest

from grainmotion.errors import InputError
from grainmotion.model.detector_alignment import DetectorAlignment
from grainmotion.model.geometry import Geometry
from grainmotion.model.scan import Scan
from grainmotion.model.volume import Volume
from grainmotion.projection.volumes import project
from grainmotion.reconstruction.reconstruct import ReconstructSettings, reconstruct
from grainmotion.rotations import rotation_matrix
from grainmotion.simulate import Ellipsoid, Particle, Sample, attenuation_volume

PANEL = (26, 34)
VOXEL = 0.1
NOISE = 0.02  # of ‖b‖
BODIES = (
    (Ellipsoid(np.array([0.5, 0.3, 0.1]), np.array([0.5, 0.6, 0.8]), rotation_matrix([0.2, 0.5, -0.4])), 1.0),
    (Ellipsoid(np.array([-0.6, -0.4, -0.2]), np.array([0.4, 0.7, 0.5]), rotation_matrix([0.0, 1.0, 0.3])), 0.6),
)
SAMPLE = Sample(tuple(Particle(shape, value) for shape, value in BODIES))


def views(beam, count=40):
    angles = np.arange(count) * 360 / count
    if beam == "parallel":
        return Geometry.parallel(angles / 2, PANEL, VOXEL)
    panel = DetectorAlignment(offset=(0.3, -0.2), tilts_deg=(2, -1, 3), axis_offset=0.1, axis_tilt_deg=(1, 0.5))
    return Geometry.cone(angles, PANEL, 4 * VOXEL, source_to_axis=40, source_to_detector=160, panel=panel)


@cache
def exact_scan(beam="cone", noise=0.0):
    return scan_of(views(beam), noise)


def scan_of(geometry, noise):
    """Chords of the ellipsoids by the quadratic formula, and white noise of a share of ‖b‖."""
    images = np.zeros((len(geometry), *PANEL))
    for i in range(len(geometry)):
        points = geometry.pixel_positions(i)
        source = geometry.vectors[i, :3]
        directions = points - source if geometry.beam == "cone" else np.broadcast_to(source, points.shape)
        directions = directions / np.linalg.norm(directions, axis=-1, keepdims=True)
        for shape, value in BODIES:
            o, d = (points - shape.center) @ shape.axes / shape.semi_axes, directions @ shape.axes / shape.semi_axes
            a, b, c = (d * d).sum(-1), (o * d).sum(-1), (o * o).sum(-1) - 1
            images[i] += value * 2 * np.sqrt(np.maximum(b * b - a * c, 0)) / a
    rng = np.random.default_rng(0)
    images += noise * np.sqrt((images**2).mean()) * rng.standard_normal(images.shape)
    return Scan(images.astype(np.float32), geometry)


GRID = Volume.zeros((26, 34, 34), VOXEL)


@cache
def truth():
    return attenuation_volume(SAMPLE, GRID, samples=4).array


@cache
def reconstructed(beam="cone", noise=0.0, **settings):
    return reconstruct(exact_scan(beam, noise), GRID, ReconstructSettings(**settings))


def error(volume):
    return np.sqrt(((volume.array - truth()) ** 2).sum() / (truth() ** 2).sum())


class TestImage:
    @pytest.mark.parametrize("beam", ["cone", "parallel"])
    @pytest.mark.parametrize("projector", ["trilinear", "exact"])
    @pytest.mark.parametrize("method", ["sart", "accelerated"])
    def test_the_ellipsoids_come_out_in_their_places(self, beam, projector, method):
        scan = scan_of(views(beam, 352 if method == "accelerated" else 40), 0.0)  # for many views, and for few
        found = reconstruct(scan, GRID, ReconstructSettings(projector=projector, method=method))
        # of 352 views that mean no pixel's area, both methods sharpen the surfaces of such small bodies alike
        alike = reconstruct(scan, GRID, ReconstructSettings(projector=projector, method="sart"))
        assert error(found.volume) < (0.12 if method == "sart" else 1.02 * error(alike.volume))
        cores = truth() > 0.999 * 1.0
        assert found.volume.array[cores].mean() == pytest.approx(1.0, abs=0.05)
        light = (truth() > 0.5999) & (truth() < 0.6001)
        assert found.volume.array[light].mean() == pytest.approx(0.6, abs=0.05)
        # mass and centre of mass of the whole
        places = np.stack(np.mgrid[:26, :34, :34], -1).reshape(-1, 3)
        for k in range(3):
            one, other = (float((a.ravel() * places[:, k]).sum() / a.sum()) for a in (found.volume.array, truth()))
            assert one == pytest.approx(other, abs=0.06)  # voxels
        assert found.volume.array.sum() == pytest.approx(truth().sum(), rel=0.02)

    def test_place_of_the_grid_is_kept_and_used(self):
        """A grid off the axis, not a cube, with its own centre: the body in it is where it was."""
        grid = Volume.zeros((18, 16, 14), VOXEL, (0.5, 0.3, 0.1))
        settings = ReconstructSettings(circular=False, sweeps=3)
        found = reconstruct(exact_scan(), grid, settings).volume
        assert (found.shape, found.voxel_size, found.center) == (grid.shape, VOXEL, grid.center)
        expected = attenuation_volume(SAMPLE, grid, samples=4).array
        inner = (slice(3, -3),) * 3
        # rays see the other body outside of the grid too, so only the shape can be right
        assert np.corrcoef(found.array[inner].ravel(), expected[inner].ravel())[0, 1] > 0.9

    def test_a_start_is_used_and_not_changed(self):
        start = Volume(truth(), VOXEL)
        found = reconstruct(exact_scan(), start, ReconstructSettings(sweeps=1))
        assert found.residuals[0] < 0.5 * reconstructed(sweeps=1).residuals[0]
        np.testing.assert_array_equal(start.array, truth())

    def test_the_same_whatever_the_run(self):
        settings = ReconstructSettings(sweeps=2, device="cpu")  # a card's sums differ by rounding
        once = reconstruct(exact_scan(), GRID, settings).volume.array
        np.testing.assert_array_equal(once, reconstruct(exact_scan(), GRID, settings).volume.array)


class TestResidual:
    @pytest.mark.parametrize("projector", ["trilinear", "exact"])
    def test_falls(self, projector):
        residuals = reconstructed(projector=projector, sweeps=6, tolerance=0.0).residuals
        assert len(residuals) == 6
        assert (np.diff(residuals) < 0).all()
        # what voxels cannot say of an ellipsoid remains: no more of it than the true voxels leave
        b = exact_scan().line_integrals
        left = np.linalg.norm(
            b - project(Volume(truth(), VOXEL), exact_scan().geometry, projector=projector)
        ) / np.linalg.norm(b)
        assert residuals[-1] < 1.1 * left

    def test_settles_at_the_noise(self):
        residuals = reconstructed(noise=NOISE, sweeps=6, tolerance=0.0).residuals
        assert residuals[-1] == pytest.approx(
            np.hypot(NOISE, reconstructed(sweeps=6, tolerance=0.0).residuals[-1]), rel=0.25
        )

    def test_is_equation_23_of_the_image_before_each_update(self):
        """From a start that fits nothing, the first views see all of b: ε starts at 1."""
        messages = []
        reconstruct(exact_scan(), GRID, ReconstructSettings(sweeps=1), progress=lambda m, d, t: messages.append(m))
        assert messages[0].endswith("ε = 1.0000")


class TestStopping:
    def test_no_significant_decrease(self):
        residuals = np.array(reconstructed(noise=NOISE, sweeps=6, tolerance=0.3).residuals)
        assert 1 < len(residuals) < 6
        assert residuals[-1] > 0.7 * residuals[-2]
        assert (residuals[1:-1] <= 0.7 * residuals[:-2]).all()

    def test_discrepancy_principle(self):
        """Stop at the first sweep whose ε is at the noise level, not later."""
        everything = reconstructed(noise=NOISE, sweeps=6, tolerance=0.0).residuals
        level = (everything[1] + everything[2]) / 2
        settings = ReconstructSettings(sweeps=6, tolerance=0.0, noise=level)
        stopped = reconstruct(exact_scan(noise=NOISE), GRID, settings)
        assert stopped.residuals == everything[:3]

    def test_sweeps_are_a_limit(self):
        assert len(reconstructed(sweeps=1, tolerance=0.0).residuals) == 1

    def test_nothing_to_see(self):
        """Radiographs of zeros give an empty volume, and no NaN."""
        empty = Scan(np.zeros((40, *PANEL), np.float32), views("cone"))
        found = reconstruct(empty, GRID)
        assert not found.volume.array.any()
        assert set(found.residuals) == {0.0}

    def test_a_grid_that_no_ray_meets(self):
        away = Volume.zeros((5, 5, 5), VOXEL, (0.0, 0.0, 500.0))
        found = reconstruct(exact_scan(), away)
        assert not found.volume.array.any()
        assert np.isfinite(found.residuals).all()


class TestAccelerated:
    def scan_and_grid(self):
        """352 views of two ellipsoids, small, with noise."""
        return scan_of(views("cone", 352), NOISE), GRID

    @pytest.mark.parametrize("shape", [(26, 34, 34), (25, 33, 31)])
    def test_the_residual_of_plain_sart_from_a_third_of_the_views(self, shape):
        """Of even and odd numbers of voxels; plain SART stops by itself, after some sweeps."""
        scan, grid = self.scan_and_grid()[0], Volume.zeros(shape, VOXEL)
        told = {"sart": [], "accelerated": []}
        left = {}
        for method, lines in told.items():
            settings = ReconstructSettings(method=method)
            volume = reconstruct(scan, grid, settings, progress=lambda *a, lines=lines: lines.append(a)).volume
            left[method] = np.linalg.norm(project(volume, scan.geometry) - scan.line_integrals)
        assert left["accelerated"] < 1.02 * left["sart"]
        sweeps = len(told["sart"]) / 352
        assert told["accelerated"][-1][1] == told["accelerated"][-1][2] < 352 * sweeps / 2.2
        assert sweeps >= 3

    def test_auto_is_accelerated_where_views_are_many_and_nothing_of_plain_sart_is_told(self):
        scan, grid = self.scan_and_grid()
        auto = reconstruct(scan, grid, ReconstructSettings()).volume.array
        quick = reconstruct(scan, grid, ReconstructSettings(method="accelerated")).volume.array
        np.testing.assert_array_equal(auto, quick)
        assert ReconstructSettings().plain(100)
        assert ReconstructSettings(sweeps=2).plain(1000)
        assert ReconstructSettings(noise=0.02).plain(1000)

    def test_starts_from_coarser_voxels(self):
        """The first subset meets an image that has the long wavelengths already, not an empty one."""
        messages = []
        reconstruct(*self.scan_and_grid(), None, progress=lambda m, d, t: messages.append(m))
        assert float(messages[0].split("= ")[1]) < 0.25

    def test_a_start_is_used(self):
        scan = self.scan_and_grid()[0]
        messages = []
        reconstruct(scan, Volume(truth(), VOXEL), None, progress=lambda m, d, t: messages.append(m))
        assert float(messages[0].split("= ")[1]) < 0.1

    def test_constraints_hold(self):
        found = reconstruct(*self.scan_and_grid()).volume.array
        y, x = np.mgrid[:34, :34] - 16.5
        assert found.min() >= 0
        assert not found[:, np.hypot(x, y) > 17.01].any()
        free = reconstruct(*self.scan_and_grid(), ReconstructSettings(non_negative=False, circular=False)).volume.array
        assert free.min() < -0.01
        assert free[:, np.hypot(x, y) > 17.01].any()

    def test_options_of_plain_sart_are_refused(self):
        with pytest.raises(InputError, match="only plain SART takes this"):
            ReconstructSettings(method="accelerated", sweeps=3)


class TestConstraints:
    def test_non_negativity(self):
        assert reconstructed(noise=NOISE).volume.array.min() >= 0
        assert reconstructed(noise=NOISE, non_negative=False, sweeps=2).volume.array.min() < -0.01

    def test_upright_cylinder(self):
        y, x = np.mgrid[:34, :34] - 16.5
        outside = np.hypot(x, y) > 17.01
        found = reconstructed(noise=NOISE).volume.array
        assert not found[:, outside].any()
        assert found[:, np.hypot(x, y) < 15].any()
        assert reconstructed(noise=NOISE, circular=False, sweeps=2).volume.array[:, outside].any()

    def test_cylinder_of_a_grid_that_is_not_square(self):
        """The cylinder is inscribed: its radius is half the shorter side, about the grid's own centre."""
        grid = Volume.zeros((10, 20, 30), VOXEL, (0.2, -0.1, 0.0))
        found = reconstruct(exact_scan(noise=NOISE), grid, ReconstructSettings(sweeps=1)).volume.array
        y, x = np.mgrid[:20, :30]
        outside = np.hypot(x - 14.5, y - 9.5) > 10.01
        assert not found[:, outside].any()
        assert found[:, ~outside].any()


class TestMaskedPixels:
    def test_harmless(self):
        """A column of dead pixels with absurd values, and a whole dead view: masked, they change little."""
        scan = exact_scan()
        images, valid = scan.line_integrals.copy(), np.ones(scan.line_integrals.shape, bool)
        rng = np.random.default_rng(1)
        valid[rng.uniform(size=valid.shape) < 0.05] = False
        valid[:, 13], valid[7] = False, False
        images[~valid] = 1e4
        settings = ReconstructSettings(sweeps=4, tolerance=0.0)
        masked = reconstruct(Scan(images, scan.geometry, valid), GRID, settings)
        assert error(masked.volume) < 1.2 * error(reconstructed(sweeps=4, tolerance=0.0).volume)
        assert masked.residuals[-1] < 1.1 * reconstructed(sweeps=4, tolerance=0.0).residuals[-1]

    def test_all_masked(self):
        scan = exact_scan()
        nothing = np.zeros(scan.line_integrals.shape, bool)
        found = reconstruct(Scan(scan.line_integrals, scan.geometry, nothing), GRID)
        assert not found.volume.array.any()


class TestSettings:
    @pytest.mark.parametrize(
        "wrong",
        [
            {"sweeps": 0},
            {"relaxation": 0},
            {"relaxation": 2},
            {"decay": 0},
            {"noise": 0},
            {"projector": "joseph"},
            {"method": "os"},
        ],
    )
    def test_refused(self, wrong):
        with pytest.raises(InputError):
            ReconstructSettings(**wrong)

    def test_progress_counts_views(self):
        told = []
        settings = ReconstructSettings(sweeps=2, tolerance=0.0, device="cpu")  # a card tells each sweep only
        reconstruct(exact_scan(), GRID, settings, progress=lambda *a: told.append(a))
        assert [done for _, done, _ in told] == list(range(1, 81))
        assert {total for *_, total in told} == {80}
        assert all("ε = " in message for message, *_ in told)
