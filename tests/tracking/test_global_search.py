"""Global search (`tracking.global_search`): large motions, when it stops, and ambiguous placements."""

from functools import cache

import numpy as np
import pytest
from validation.paper import images

from few_grains import errors, grain_set, motions, radiographs
from grainmotion.model.motions import Status
from grainmotion.model.pose import Pose
from grainmotion.projection.grain_arrays import GrainArrays
from grainmotion.rotations import rotation_matrix
from grainmotion.tracking.global_search import affine_field_through
from grainmotion.tracking.track import TrackSettings, track

EXACTLY = TrackSettings(gain=False, trend="none", tolerance=1e-10, iterations=60)


def attempts(measured):
    return {stage.split(",")[0] for stage, _ in measured.fit.costs if stage.startswith("search")}


class TestThreeDimensions:
    def test_all_grains_rotated_by_75_degrees_and_shifted_by_half_a_diameter(self):
        """In independent directions: most fail without the search, and all are registered with it."""
        rng = np.random.default_rng(4)
        rotations, shifts = rng.normal(size=(2, 5, 3))
        rotations *= 75.0 / np.linalg.norm(rotations, axis=1, keepdims=True)
        shifts *= 0.7 / np.linalg.norm(shifts, axis=1, keepdims=True)
        truth = motions(grain_set(), shifts, rotations)
        scan = radiographs(grain_set(), truth)
        plain = track(grain_set(), scan, settings=TrackSettings(search=False))
        assert not plain.ok.all()
        measured = track(grain_set(), scan)
        u, w = errors(measured, truth)
        assert measured.ok.all(), measured.reasons
        assert np.abs(u).max() < 0.05
        assert np.abs(w).max() < 1.0

    def test_no_search_if_all_grains_fit(self):
        assert not attempts(track(grain_set(), radiographs(grain_set(), motions(grain_set(), 0.05, 2.0))))

    def test_radiographs_of_other_grains_end_the_search_early(self):
        """No placement fits: the search ends after two failed attempts, and no grain converges."""
        scan = radiographs(grain_set(seed=7), motions(grain_set(), 0.3, 40.0))
        measured = track(grain_set(), scan)
        assert len(attempts(measured)) <= 4
        assert not measured.ok.any()


@cache
def discs():
    return GrainArrays.of(images.draw(0).grains())


@cache
def dense():
    """Six grains in a plane, and their motions."""
    grains = images.draw(3).grains("dense")
    return grains, images.large_motions(grains, 3)


class TestAffineField:
    """The affine field of the registered grains predicts the positions of the others."""

    BASE = Pose(np.zeros((30, 3)), np.tile(np.eye(3), (30, 1, 1)))

    def affine(self):
        return discs().centers * (0.15, 0.1, 0.0) + (3.0, -2.0, 0.0)

    def test_misregistered_grains_count_little(self):
        rng = np.random.default_rng(0)
        positions = self.affine()
        wrong = rng.permutation(30)[:9]
        positions[wrong, :2] += rng.uniform(-12, 12, (9, 2))
        field = affine_field_through(Pose(positions, rotation_matrix(rng.normal(size=(30, 3)))), discs(), self.BASE)
        assert np.abs(field.translations - self.affine()).max() < 0.5
        np.testing.assert_array_equal(field.matrices, self.BASE.matrices)

    def test_few_grains_have_no_field(self):
        few = discs().select(range(5))
        base = Pose(np.zeros((5, 3)), np.tile(np.eye(3), (5, 1, 1)))
        assert affine_field_through(Pose(self.affine()[:5], base.matrices), few, base) is base


class TestPlane:
    def test_motions_are_exact_without_noise(self):
        grains, truth = dense()
        measured = track(grains, images.observe(grains, truth, 4), settings=EXACTLY)
        assert measured.ok.all()
        assert images.errors(measured, truth).max() < 1e-9

    def test_with_noise_a_placement_is_confirmed_by_another_attempt(self):
        grains, truth = dense()
        scan = images.observe(grains, truth, 4)
        noisy = scan.line_integrals + 0.01 * np.random.default_rng(0).normal(size=scan.line_integrals.shape)
        measured = track(grains, type(scan)(noisy, scan.geometry))
        assert len(attempts(measured)) >= 1
        assert measured.ok.all(), measured.reasons
        placement_errors = images.errors(measured, truth)
        assert placement_errors[:, 0].max() < 0.1
        assert np.rad2deg(placement_errors[:, 1].max()) < 1.0

    def test_no_wrong_placement_from_one_view_is_converged(self):
        """One view of six grains determines little: other placements fit too, and must not be converged."""
        grains, truth = dense()
        scan = images.observe(grains, truth, 2).select([0])
        measured = track(grains, scan, settings=EXACTLY)
        placement_errors = images.errors(measured, truth)
        off = (placement_errors[:, 0] > 0.1) | (placement_errors[:, 1] > np.deg2rad(1.0))
        assert off.any()
        assert not (measured.ok & off).any()
        assert all(measured.reasons[k] for k in np.flatnonzero(off))

    @pytest.mark.parametrize("rotation", [-85.0, 70.0])
    def test_one_grain_from_a_start_that_is_rotated_far(self, rotation):
        grains = images.draw(0).grains("one")
        truth = motions(grains, 0.0, 0.0)
        start = motions(grains, 0.0, (0.0, 0.0, rotation))
        measured = track(grains, images.observe(grains, truth, 2), start, EXACTLY)
        assert measured.statuses[0] == Status.CONVERGED.value
        assert images.errors(measured, truth).max() < 1e-9
