"""Ill-determined directions (`uncertainty.weak_directions`): names, prior, no effect on others."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import sparse

from few_grains import PANEL, VOXEL, errors, grain_set, motions, radiographs, small_motions
from grainmotion.model.geometry import Geometry
from grainmotion.model.motions import Status
from grainmotion.model.pose import Pose
from grainmotion.model.scan import Scan
from grainmotion.projection.footprints import footprint_patches
from grainmotion.projection.grain_arrays import GrainArrays
from grainmotion.rotations import rotation_vector
from grainmotion.tracking.track import TrackSettings, track
from grainmotion.uncertainty.weak_directions import (
    MAX_SCALED_VARIANCE,
    PRIOR_ROTATION,
    PRIOR_SHIFT_DIAMETERS,
    WEAK_SD_SHARE,
    poorly_determined,
    weak_directions,
)

GRAINS = grain_set(finer=1)
PACKED = GrainArrays.of(GRAINS)
POSE = Pose(np.zeros((5, 3)), np.tile(np.eye(3), (5, 1, 1)))
SCALES = np.stack([np.repeat([PRIOR_SHIFT_DIAMETERS * 2 * r, PRIOR_ROTATION], 3) for r in PACKED.radii])


def random_covariances(size, seed=0):
    """Random covariances, of about ``size`` standard deviations of the prior."""
    roots = np.random.default_rng(seed).normal(size=(5, 6, 8))
    scaled = size**2 * roots @ roots.transpose(0, 2, 1) / 8
    return scaled * SCALES[:, :, None] * SCALES[:, None, :]


def block_diagonal(blocks):
    n = len(blocks)
    return sparse.bsr_array((blocks, np.arange(n), np.arange(n + 1)), shape=(6 * n, 6 * n))


class TestPrior:
    """If all directions are weak, the prior is one more observation; if none is, there is no prior."""

    PRECISIONS = np.stack([np.diag(1 / s**2) for s in SCALES])

    def test_posterior_if_all_directions_are_weak(self):
        covariances = random_covariances(30.0)
        weak = weak_directions(covariances, PACKED)
        assert weak.flags.all()
        expected = np.linalg.inv(np.linalg.inv(covariances) + self.PRECISIONS)
        shape = SCALES[:, :, None] * SCALES[:, None, :]
        np.testing.assert_allclose(weak.posterior() / shape, expected / shape, atol=1e-9)

    def test_posterior_if_no_direction_is_weak(self):
        covariances = random_covariances(0.02)
        weak = weak_directions(covariances, PACKED)
        assert not weak.flags.any()
        np.testing.assert_allclose(weak.posterior(), covariances, rtol=1e-9)
        hessian = block_diagonal(np.linalg.inv(covariances))
        assert not weak.prior(hessian, POSE).precisions.any()

    @pytest.mark.parametrize("variance", [1.0, 1e-4])
    def test_prior_in_units_of_the_cost(self, variance):
        """For a covariance of σ² H⁻¹, the prior's precision in the cost is σ² over its own variances."""
        covariances = random_covariances(30.0)
        hessian = block_diagonal(variance * np.linalg.inv(covariances))
        prior = weak_directions(covariances, PACKED).prior(hessian, POSE)
        shape = SCALES[:, :, None] * SCALES[:, None, :]
        np.testing.assert_allclose(
            prior.precisions * shape, np.tile(variance * np.eye(6), (5, 1, 1)), atol=1e-6 * variance
        )
        assert prior.pose is POSE

    def test_one_oblique_weak_direction(self):
        """The prior acts along it only, and only its variance decreases."""
        axes = np.linalg.qr(np.random.default_rng(1).normal(size=(6, 6)))[0]
        variances = np.array([1e-4, 1e-3, 1e-4, 9.0, 1e-4, 1e-3])
        scaled = np.einsum("ij,j,kj->ik", axes, variances, axes)
        covariances = scaled * SCALES[:, :, None] * SCALES[:, None, :]
        weak = weak_directions(covariances, PACKED)
        np.testing.assert_array_equal(weak.flags.sum(axis=1), 1)
        posterior = weak.posterior() / (SCALES[:, :, None] * SCALES[:, None, :])
        variances[3] = 9 / 10
        np.testing.assert_allclose(
            posterior, np.tile(np.einsum("ij,j,kj->ik", axes, variances, axes), (5, 1, 1)), atol=1e-9
        )
        precisions = weak.prior(block_diagonal(np.linalg.inv(covariances)), POSE).precisions
        precisions *= SCALES[:, :, None] * SCALES[:, None, :]
        np.testing.assert_allclose(precisions, np.tile(np.outer(axes[:, 3], axes[:, 3]), (5, 1, 1)), atol=1e-6)

    def test_undetermined_directions(self):
        covariances = random_covariances(0.02)
        covariances[2] = 1e12 * np.eye(6)
        covariances[3, 1] = covariances[3, :, 1] = 0
        covariances[3, 1, 1] = np.inf
        weak = weak_directions(np.where(np.isinf(covariances), 1e30, covariances), PACKED)
        assert (weak.variances <= 1.01 * MAX_SCALED_VARIANCE).all()
        sd = np.sqrt(np.diagonal(weak.posterior(), axis1=1, axis2=2)) / SCALES
        np.testing.assert_allclose(sd[2], 1, rtol=1e-3)
        assert sd[3, 1] == pytest.approx(1, rel=1e-3)
        assert np.delete(sd[3], 1).max() < 0.1
        assert np.isfinite(weak_directions(np.full((5, 6, 6), np.nan), PACKED).posterior()).all()

    def test_limit_of_a_weak_direction(self):
        for share, expected in ((0.9 * WEAK_SD_SHARE, False), (1.1 * WEAK_SD_SHARE, True)):
            covariances = share**2 * np.stack([np.diag(s**2) for s in SCALES])
            np.testing.assert_array_equal(weak_directions(covariances, PACKED).flags, expected)


class TestNames:
    @pytest.mark.parametrize(
        ("sd", "names"),
        [
            ([1, 1, 1, 1, 1, 1], []),
            ([1, 9, 1, 1, 1, 1], ["translation along y"]),
            ([9, 9, 9, 1, 1, 1], ["translation along any axis"]),
            ([1, 1, 9, 9, 1, 1], ["translation along z", "rotation about x"]),
        ],
    )
    def test_names_of_axes(self, sd, names):
        covariance = np.diag(np.square(sd).astype(float))
        assert poorly_determined(covariance, (3.0, 3.0)) == names

    def test_name_of_an_oblique_direction(self):
        direction = np.array([0.6, -0.8, 0.0])
        covariance = np.eye(6)
        covariance[:3, :3] += 99 * np.outer(direction, direction)
        (name,) = poorly_determined(covariance, (3.0, 3.0))
        x, y, z = (float(part) for part in name.removeprefix("translation along (").removesuffix(")").split(","))
        np.testing.assert_allclose(abs(x * 0.6 - y * 0.8), 1)
        assert z == 0


VIEWS = Geometry.parallel((0.0, 50.0, 95.0, 140.0), PANEL, VOXEL)
TRUTH = small_motions(grain_set(finer=1), voxels=1.0, degrees=2.0)


def hidden(grain, seen_by):
    """Radiographs on which one grain's footprint, and two pixels around it, are valid in the views ``seen_by`` only."""
    packed = GrainArrays.of(grain_set())
    boxes = footprint_patches(packed, Pose(TRUTH.translations, TRUTH.matrices), VIEWS, margin=2).boxes
    valid = np.ones((4, *PANEL), bool)
    for _, view, r0, r1, c0, c1 in boxes[boxes[:, 0] == grain]:
        valid[view, r0:r1, c0:c1] = view in seen_by
    scan = radiographs(grain_set(), TRUTH, views=VIEWS)
    return Scan(scan.line_integrals, VIEWS, valid)


HIDDEN_GRAIN = 4


@pytest.fixture(scope="module")
def measured():
    return track(grain_set(), hidden(HIDDEN_GRAIN, {0}), settings=TrackSettings(search=False))


class TestHiddenGrain:
    """A grain behind an opaque object in all views but one."""

    GRAIN = HIDDEN_GRAIN

    def test_its_depth_is_named(self, measured):
        assert measured.statuses[self.GRAIN] == Status.POORLY_DETERMINED.value
        assert "translation along y" in measured.reasons[self.GRAIN]
        assert "translation along x" not in measured.reasons[self.GRAIN]

    def test_its_depth_is_close_to_the_prior(self, measured):
        """Within three standard deviations of the prior, which its covariance states."""
        deviation = PRIOR_SHIFT_DIAMETERS * 2 * PACKED.radii[self.GRAIN]
        sd = np.sqrt(np.diagonal(measured.covariances[self.GRAIN]))
        assert sd[1] == pytest.approx(deviation, rel=0.1)
        assert np.abs(measured.translations[self.GRAIN, 1] - TRUTH.translations[self.GRAIN, 1]) < 3 * deviation
        assert sd[[0, 2]].max() < 0.1 * deviation

    def test_its_other_translations_are_accurate(self, measured):
        u, _ = errors(measured, TRUTH)
        assert np.abs(u[self.GRAIN, [0, 2]]).max() < 0.1

    def test_the_other_grains_are_accurate(self, measured):
        u, w = errors(measured, TRUTH)
        others = np.delete(np.arange(5), self.GRAIN)
        assert measured.ok[others].all(), measured.reasons
        assert np.abs(u[others]).max() < 0.06
        assert np.abs(w[others]).max() < 1.5


class TestOneParallelView:
    def test_depths_stay_at_the_start(self):
        """The start is 0.3 mm, which the view cannot contradict."""
        grains = grain_set(2)
        truth = motions(grains, (0.05, 0.3, -0.05), (0.0, 3.0, 0.0))
        start = motions(grains, (0.0, 0.3, 0.0))
        views = Geometry.parallel([0.0], PANEL, VOXEL)
        settings = TrackSettings(fields=False, search=False)
        measured = track(grains, radiographs(grains, truth, views=views), start, settings)
        u, _ = errors(measured, truth)
        np.testing.assert_allclose(measured.translations[:, 1], 0.3, atol=0.02)
        assert np.abs(u[:, [0, 2]]).max() < 0.1
        assert set(measured.statuses) == {Status.POORLY_DETERMINED.value}
        sd = np.sqrt(np.diagonal(measured.covariances, axis1=1, axis2=2))
        np.testing.assert_allclose(sd[:, 1], PRIOR_SHIFT_DIAMETERS * 2 * GrainArrays.of(grains).radii, rtol=0.05)
        rotations = rotation_vector(measured.matrices @ truth.matrices.transpose(0, 2, 1))
        assert np.abs(rotations[:, 1]).max() < 0.02  # about the beam they are determined

    def test_depths_follow_the_start(self):
        grains = grain_set(2)
        truth = motions(grains, (0.0, 0.2, 0.0))
        views = Geometry.parallel([0.0], PANEL, VOXEL)
        scan = radiographs(grains, truth, views=views)
        settings = TrackSettings(fields=False, search=False)
        ends = [track(grains, scan, replace(motions(grains, (0.0, y, 0.0))), settings) for y in (0.0, 0.2)]
        np.testing.assert_allclose(ends[1].translations[:, 1] - ends[0].translations[:, 1], 0.2, atol=0.02)
