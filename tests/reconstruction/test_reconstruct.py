"""`reconstruct` on ellipsoids whose line integrals are exact, not computed by our projector."""

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
NOISE = 0.02  # share of the norm of the line integrals
BODIES = (
    (Ellipsoid(np.array([0.5, 0.3, 0.1]), np.array([0.5, 0.6, 0.8]), rotation_matrix([0.2, 0.5, -0.4])), 1.0),
    (Ellipsoid(np.array([-0.6, -0.4, -0.2]), np.array([0.4, 0.7, 0.5]), rotation_matrix([0.0, 1.0, 0.3])), 0.6),
)
SAMPLE = Sample(tuple(Particle(shape, value) for shape, value in BODIES))


def views(beam, count=40):
    angles = np.arange(count) * 360 / count
    if beam == "parallel":
        return Geometry.parallel(angles / 2, PANEL, VOXEL)
    panel = DetectorAlignment(
        detector_offset=(0.3, -0.2), detector_tilts_deg=(2, -1, 3), axis_offset=0.1, axis_tilt_deg=(1, 0.5)
    )
    return Geometry.cone(angles, PANEL, 4 * VOXEL, source_to_axis=40, source_to_detector=160, panel=panel)


@cache
def exact_scan(beam="cone", noise=0.0):
    return scan_of(views(beam), noise)


def scan_of(geometry, noise):
    """Line integrals of the ellipsoids by the quadratic formula, with white noise of the given share of their norm."""
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
    def test_ellipsoids_are_reconstructed_in_place(self, beam, projector, method):
        scan = scan_of(views(beam, 352 if method == "accelerated" else 40), 0.0)
        result = reconstruct(scan, GRID, ReconstructSettings(projector=projector, method=method))
        # line integrals at pixel centres, not means over pixels: with 352 views both methods sharpen surfaces alike
        sart = reconstruct(scan, GRID, ReconstructSettings(projector=projector, method="sart"))
        assert error(result.volume) < (0.12 if method == "sart" else 1.02 * error(sart.volume))
        cores = truth() > 0.999 * 1.0
        assert result.volume.array[cores].mean() == pytest.approx(1.0, abs=0.05)
        light = (truth() > 0.5999) & (truth() < 0.6001)
        assert result.volume.array[light].mean() == pytest.approx(0.6, abs=0.05)
        # mass and centre of mass of the whole
        voxels = np.stack(np.mgrid[:26, :34, :34], -1).reshape(-1, 3)
        for k in range(3):
            one, other = (float((a.ravel() * voxels[:, k]).sum() / a.sum()) for a in (result.volume.array, truth()))
            assert one == pytest.approx(other, abs=0.06)  # voxels
        assert result.volume.array.sum() == pytest.approx(truth().sum(), rel=0.02)

    def test_grid_off_the_axis(self):
        """A grid off the axis with three different sides: the body inside is reconstructed in place."""
        grid = Volume.zeros((18, 16, 14), VOXEL, (0.5, 0.3, 0.1))
        settings = ReconstructSettings(circular=False, sweeps=3)
        result = reconstruct(exact_scan(), grid, settings).volume
        assert (result.shape, result.voxel_size, result.center) == (grid.shape, VOXEL, grid.center)
        expected = attenuation_volume(SAMPLE, grid, samples=4).array
        inner = (slice(3, -3),) * 3
        # the other body lies outside the grid but in the rays, so only the shape can be right
        assert np.corrcoef(result.array[inner].ravel(), expected[inner].ravel())[0, 1] > 0.9

    def test_initial_volume_is_used_and_not_changed(self):
        initial = Volume(truth(), VOXEL)
        result = reconstruct(exact_scan(), initial, ReconstructSettings(sweeps=1))
        assert result.residuals[0] < 0.5 * reconstructed(sweeps=1).residuals[0]
        np.testing.assert_array_equal(initial.array, truth())

    def test_result_is_reproducible(self):
        settings = ReconstructSettings(sweeps=2, device="cpu")  # sums on a GPU differ by rounding
        once = reconstruct(exact_scan(), GRID, settings).volume.array
        np.testing.assert_array_equal(once, reconstruct(exact_scan(), GRID, settings).volume.array)


class TestResidual:
    @pytest.mark.parametrize("projector", ["trilinear", "exact"])
    def test_residual_decreases_with_every_sweep(self, projector):
        residuals = reconstructed(projector=projector, sweeps=6, tolerance=0.0).residuals
        assert len(residuals) == 6
        assert (np.diff(residuals) < 0).all()
        # voxels cannot represent an ellipsoid exactly: the residual of the true voxels remains
        b = exact_scan().line_integrals
        remaining = np.linalg.norm(
            b - project(Volume(truth(), VOXEL), exact_scan().geometry, projector=projector)
        ) / np.linalg.norm(b)
        assert residuals[-1] < 1.1 * remaining

    def test_residual_converges_to_the_noise_level(self):
        residuals = reconstructed(noise=NOISE, sweeps=6, tolerance=0.0).residuals
        assert residuals[-1] == pytest.approx(
            np.hypot(NOISE, reconstructed(sweeps=6, tolerance=0.0).residuals[-1]), rel=0.25
        )

    def test_is_equation_23_of_the_image_before_each_update(self):
        """From an empty volume the residual of the first views is all of b: ε starts at 1."""
        messages = []
        reconstruct(exact_scan(), GRID, ReconstructSettings(sweeps=1), progress=lambda m, d, t: messages.append(m))
        assert messages[0].endswith("ε = 1.0000")


class TestStopping:
    def test_stops_without_a_significant_decrease(self):
        residuals = np.array(reconstructed(noise=NOISE, sweeps=6, tolerance=0.3).residuals)
        assert 1 < len(residuals) < 6
        assert residuals[-1] > 0.7 * residuals[-2]
        assert (residuals[1:-1] <= 0.7 * residuals[:-2]).all()

    def test_stops_at_the_noise_level(self):
        """Discrepancy principle: stop at the first sweep whose ε is at the noise level."""
        all_residuals = reconstructed(noise=NOISE, sweeps=6, tolerance=0.0).residuals
        level = (all_residuals[1] + all_residuals[2]) / 2
        settings = ReconstructSettings(sweeps=6, tolerance=0.0, noise=level)
        stopped = reconstruct(exact_scan(noise=NOISE), GRID, settings)
        assert stopped.residuals == all_residuals[:3]

    def test_sweeps_limit_the_iteration(self):
        assert len(reconstructed(sweeps=1, tolerance=0.0).residuals) == 1

    def test_zero_radiographs_give_an_empty_volume(self):
        """The volume is zero, without NaN."""
        empty = Scan(np.zeros((40, *PANEL), np.float32), views("cone"))
        result = reconstruct(empty, GRID)
        assert not result.volume.array.any()
        assert set(result.residuals) == {0.0}

    def test_grid_that_no_ray_crosses_stays_empty(self):
        distant = Volume.zeros((5, 5, 5), VOXEL, (0.0, 0.0, 500.0))
        result = reconstruct(exact_scan(), distant)
        assert not result.volume.array.any()
        assert np.isfinite(result.residuals).all()


class TestAccelerated:
    def scan_and_grid(self):
        """352 noisy views of the two ellipsoids, and the grid."""
        return scan_of(views("cone", 352), NOISE), GRID

    @pytest.mark.parametrize("shape", [(26, 34, 34), (25, 33, 31)])
    def test_residual_of_plain_sart_in_less_than_half_of_its_updates(self, shape):
        """For even and odd numbers of voxels; plain SART stops by itself, after three sweeps or more."""
        scan, grid = self.scan_and_grid()[0], Volume.zeros(shape, VOXEL)
        updates = {"sart": [], "accelerated": []}
        residual = {}
        for method, calls in updates.items():
            settings = ReconstructSettings(method=method)
            volume = reconstruct(scan, grid, settings, progress=lambda *a, calls=calls: calls.append(a)).volume
            residual[method] = np.linalg.norm(project(volume, scan.geometry) - scan.line_integrals)
        assert residual["accelerated"] < 1.02 * residual["sart"]
        sweeps = len(updates["sart"]) / 352
        assert updates["accelerated"][-1][1] == updates["accelerated"][-1][2] < 352 * sweeps / 2.2
        assert sweeps >= 3

    def test_auto_is_accelerated_with_many_views_and_without_options_of_plain_sart(self):
        scan, grid = self.scan_and_grid()
        auto = reconstruct(scan, grid, ReconstructSettings()).volume.array
        accelerated = reconstruct(scan, grid, ReconstructSettings(method="accelerated")).volume.array
        np.testing.assert_array_equal(auto, accelerated)
        assert ReconstructSettings().plain(100)
        assert ReconstructSettings(sweeps=2).plain(1000)
        assert ReconstructSettings(noise=0.02).plain(1000)

    def test_starts_from_a_coarse_reconstruction(self):
        """The first subset starts from a volume that contains the low frequencies, not from zero."""
        messages = []
        reconstruct(*self.scan_and_grid(), None, progress=lambda m, d, t: messages.append(m))
        assert float(messages[0].split("= ")[1]) < 0.25

    def test_initial_volume_is_used(self):
        scan = self.scan_and_grid()[0]
        messages = []
        reconstruct(scan, Volume(truth(), VOXEL), None, progress=lambda m, d, t: messages.append(m))
        assert float(messages[0].split("= ")[1]) < 0.1

    def test_constraints_can_be_switched_off(self):
        constrained = reconstruct(*self.scan_and_grid()).volume.array
        y, x = np.mgrid[:34, :34] - 16.5
        assert constrained.min() >= 0
        assert not constrained[:, np.hypot(x, y) > 17.01].any()
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

    def test_voxels_outside_the_cylinder_are_zero(self):
        y, x = np.mgrid[:34, :34] - 16.5
        outside = np.hypot(x, y) > 17.01
        volume = reconstructed(noise=NOISE).volume.array
        assert not volume[:, outside].any()
        assert volume[:, np.hypot(x, y) < 15].any()
        assert reconstructed(noise=NOISE, circular=False, sweeps=2).volume.array[:, outside].any()

    def test_cylinder_of_a_grid_that_is_not_square(self):
        """The cylinder is inscribed: its radius is half the shorter side, about the grid's own centre."""
        grid = Volume.zeros((10, 20, 30), VOXEL, (0.2, -0.1, 0.0))
        volume = reconstruct(exact_scan(noise=NOISE), grid, ReconstructSettings(sweeps=1)).volume.array
        y, x = np.mgrid[:20, :30]
        outside = np.hypot(x - 14.5, y - 9.5) > 10.01
        assert not volume[:, outside].any()
        assert volume[:, ~outside].any()


class TestMaskedPixels:
    def test_masked_pixels_change_little(self):
        """Dead pixels, a detector row and a whole view with absurd values, all masked."""
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

    def test_all_pixels_masked_give_an_empty_volume(self):
        scan = exact_scan()
        nothing = np.zeros(scan.line_integrals.shape, bool)
        result = reconstruct(Scan(scan.line_integrals, scan.geometry, nothing), GRID)
        assert not result.volume.array.any()


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
    def test_bad_values_are_refused(self, wrong):
        with pytest.raises(InputError):
            ReconstructSettings(**wrong)

    def test_progress_counts_views(self):
        calls = []
        settings = ReconstructSettings(sweeps=2, tolerance=0.0, device="cpu")  # a GPU reports once a sweep
        reconstruct(exact_scan(), GRID, settings, progress=lambda *a: calls.append(a))
        assert [done for _, done, _ in calls] == list(range(1, 81))
        assert {total for *_, total in calls} == {80}
        assert all("ε = " in message for message, *_ in calls)
