"""Tracking a few small grains (`tracking.track`); accuracy is tested in `physics/`."""

import sys
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from few_grains import (
    ANGLES,
    PANEL,
    VOXEL,
    errors,
    geometry,
    grain_set,
    motions,
    radiographs,
    small_motions,
)
from grainmotion.analysis.validation import compare
from grainmotion.errors import InputError
from grainmotion.model.geometry import Geometry
from grainmotion.model.grains import Grain, GrainSet
from grainmotion.model.motions import Motions, Status
from grainmotion.model.scan import Scan
from grainmotion.model.volume import Volume
from grainmotion.rotations import rotation_vector
from grainmotion.solvers.gauss_newton import SIGNIFICANT_COST_CHANGE
from grainmotion.tracking.track import PAPER, TrackSettings, track
from scenes import one_body

TRUTH = small_motions(grain_set(finer=1))


def assert_registered(measured, truth, voxels=0.05, degrees=1.0, among=slice(None)):
    u, w = errors(measured, truth)
    assert (measured.statuses[among] == Status.CONVERGED.value).all(), measured.reasons
    assert np.abs(u[among]).max() < voxels
    assert np.abs(w[among]).max() < degrees


def assert_consistent(measured):
    """Motions are NaN just for grains without one; every grain that did not converge has a reason."""
    without_motion = np.isin(measured.statuses, [Status.LEFT_FIELD.value, Status.NOT_FITTED.value, Status.ABSENT.value])
    numbers = np.hstack(
        [measured.translations, measured.rotations, np.diagonal(measured.covariances, axis1=1, axis2=2)]
    )
    np.testing.assert_array_equal(np.isnan(numbers), np.repeat(without_motion[:, None], 12, axis=1))
    for status, reason in zip(measured.statuses, measured.reasons, strict=True):
        assert bool(reason) == (status != Status.CONVERGED.value)
        assert not reason or ";" in reason  # cause; remedy


class TestRegistration:
    @pytest.mark.parametrize("count", [1, 2, 5])
    def test_independent_motions(self, count):
        grains = grain_set(count)
        truth = small_motions(grains)
        measured = track(grains, radiographs(grains, truth))
        assert_registered(measured, truth)
        assert_consistent(measured)
        np.testing.assert_array_equal(measured.labels, grains.labels)
        np.testing.assert_array_equal(measured.centers, grains.centers)

    def test_parallel_beam_and_a_rectangular_panel(self):
        views = Geometry.parallel(ANGLES, (70, 52), VOXEL)
        assert_registered(track(grain_set(), radiographs(grain_set(), TRUTH, views=views)), TRUTH)

    def test_pixels_that_are_not_square(self):
        wide = geometry(shape=(52, 40)).vectors.copy()
        wide[:, 6:9] *= 1.7
        views = Geometry(wide, (52, 40))
        assert_registered(track(grain_set(), radiographs(grain_set(), TRUTH, views=views)), TRUTH)

    def test_a_large_shift_of_the_whole_sample(self):
        """Ten voxels, most of a grain's width, from a start of zero."""
        truth = motions(grain_set(), (0.6, -0.7, 0.4), (0.0, 0.0, 5.0))
        wide = geometry(shape=(72, 84))
        assert_registered(track(grain_set(), radiographs(grain_set(), truth, views=wide)), truth)

    def test_a_sample_off_the_axis(self):
        """A volume whose centre is far from the axis, with source and panel shifted by as much."""
        offset = np.array([3.0, -2.0, 1.5])

        def shifted(volume):
            return replace(volume, center=tuple(np.add(volume.center, offset)))

        grains = GrainSet(
            tuple(
                replace(g, volume=shifted(g.volume), fine=shifted(g.fine), center=g.center + offset)
                for g in grain_set().grains
            )
        )
        rows = geometry().vectors.copy()
        rows[:, :3] += offset
        rows[:, 3:6] += offset
        truth = replace(TRUTH, centers=grains.centers)
        assert_registered(track(grains, radiographs(grains, truth, views=Geometry(rows, PANEL))), truth)

    def test_a_fixed_background(self):
        y, x = (np.mgrid[:60, :60] - 29.5) * VOXEL
        tube = Volume(np.tile(0.7 * (np.abs(np.hypot(x, y) - 2.6) < 0.15), (46, 1, 1)), VOXEL)
        grains = GrainSet(grain_set().grains, one_body(tube))
        assert_registered(track(grains, radiographs(grains, TRUTH)), TRUTH)

    def test_the_papers_variant(self):
        """Siddon, finite differences, no stages: less accurate, and for small motions only."""
        small = replace(TRUTH, translations=TRUTH.translations / 3, rotations=TRUTH.rotations / 3)
        measured = track(grain_set(), radiographs(grain_set(), small, noise=0.005), settings=PAPER)
        u, w = errors(measured, small)
        assert np.sqrt((u**2).mean()) < 0.2
        assert np.sqrt((w**2).mean()) < 2.0
        assert measured.fit.gain == 1.0

    def test_masked_pixels_do_not_count(self):
        scan = radiographs(grain_set(), TRUTH)
        valid = np.random.default_rng(5).uniform(size=scan.line_integrals.shape) > 0.1
        valid[:, :, 30] = False
        images = np.where(valid, scan.line_integrals, 50.0).astype(np.float32)
        assert_registered(track(grain_set(), Scan(images, scan.geometry, valid)), TRUTH)

    def test_negative_voxels_of_the_reference(self):
        """Other software may give negative voxels; they are part of the grain's image."""
        rng = np.random.default_rng(6)
        with_noise = []
        for g in grain_set().grains:
            noise = np.zeros(g.volume.shape, np.float32)
            noise[2:-2, 2:-2, 2:-2] = 0.03 * rng.standard_normal([n - 4 for n in g.volume.shape])
            with_noise.append(replace(g, volume=replace(g.volume, array=g.volume.array + noise), fine=None))
        grains = GrainSet(tuple(with_noise))
        assert min(g.volume.array.min() for g in with_noise) < 0
        assert_registered(track(grains, radiographs(grains, TRUTH)), TRUTH)


class TestGain:
    def test_a_drift_of_a_tenth_is_estimated_and_does_not_bias_motions(self):
        measured = track(grain_set(), radiographs(grain_set(), TRUTH, gain=1.1, offset=0.02))
        assert_registered(measured, TRUTH)
        assert measured.fit.gain == pytest.approx(1.1, abs=2e-3)
        assert measured.fit.offset == pytest.approx(0.02, abs=2e-3)

    def test_gain_and_offset_can_be_fixed(self):
        measured = track(grain_set(), radiographs(grain_set(), TRUTH), settings=TrackSettings(gain=False, trend="none"))
        assert_registered(measured, TRUTH)
        assert (measured.fit.gain, measured.fit.offset) == (1.0, 0.0)


class TestStart:
    def test_start_from_the_state_before(self):
        """A motion too large for a start of zero is measured from that of the state before."""
        before = motions(grain_set(), (0.5, 0.4, -0.3), [(0, 0, 70)] * 5)
        after = replace(
            before,
            translations=before.translations + TRUTH.translations,
            rotations=rotation_vector(TRUTH.matrices @ before.matrices),
        )
        wide = geometry(shape=(72, 84))
        measured = track(grain_set(), radiographs(grain_set(), after, views=wide), before)
        assert_registered(measured, after)

    def test_missing_labels_are_an_error(self):
        start = Motions.identity(grain_set().labels[:3], grain_set().centers[:3])
        with pytest.raises(InputError, match=r"initial: grains \[4, 5\] have no row"):
            track(grain_set(), radiographs(grain_set(), TRUTH), start)


class TestGrainsWithoutAMotion:
    """Grains that cannot be measured have a status, and do not disturb the others."""

    def test_grains_that_left_the_field_of_view(self):
        """The shift of the whole sample moves the two upper grains over the panel's edge."""
        truth = replace(TRUTH, translations=TRUTH.translations + np.array([0, 0, 1.6]))
        edge = geometry(shape=(48, 64))
        measured = track(grain_set(), radiographs(grain_set(), truth, views=edge))
        assert (measured.statuses[3:] == Status.LEFT_FIELD.value).all()
        assert_registered(measured, truth, among=[0, 1, 2])
        assert_consistent(measured)
        comparison = compare(measured, truth, VOXEL)
        np.testing.assert_array_equal(comparison.failed, [False, False, False, True, True])
        assert np.isnan(comparison.rotation_errors_deg[3:]).all()

    def test_a_start_off_the_panel_is_not_fitted(self):
        start = motions(grain_set())
        start.translations[3] = 0, 0, 50.0
        images = radiographs(
            grain_set(), replace(TRUTH, translations=np.where([[i == 3] for i in range(5)], 50.0, TRUTH.translations))
        )
        settings = TrackSettings(fields=False)
        measured = track(grain_set(), images, start, settings)
        assert measured.statuses[3] == Status.NOT_FITTED.value
        assert "no view sees it" in measured.reasons[3]
        assert_registered(measured, TRUTH, among=[0, 1, 2, 4])
        assert_consistent(measured)

    @pytest.mark.parametrize("missing", [0, 3, *(pytest.param(k, marks=pytest.mark.slow) for k in (1, 2, 4))])
    def test_a_missing_grain(self, missing):
        """A grain removed between the states is absent, and the others are registered."""
        remaining = grain_set().without([missing])
        kept = np.delete(np.arange(5), missing)
        truth = replace(
            Motions.identity(remaining.labels, remaining.centers),
            translations=TRUTH.translations[kept],
            rotations=TRUTH.rotations[kept],
        )
        measured = track(grain_set(), radiographs(remaining, truth))
        assert measured.statuses[missing] == Status.ABSENT.value
        assert "not on the radiographs" in measured.reasons[missing]
        np.testing.assert_array_equal(measured.labels, grain_set().labels)
        assert_registered(measured, TRUTH, among=kept)
        assert_consistent(measured)

    def test_two_of_five_grains_missing(self):
        """Both are absent, and the others are registered."""
        remaining = grain_set().without([2, 4])
        kept = [0, 1, 3]
        truth = replace(
            Motions.identity(remaining.labels, remaining.centers),
            translations=TRUTH.translations[kept],
            rotations=TRUTH.rotations[kept],
        )
        measured = track(grain_set(), radiographs(remaining, truth))
        assert (measured.statuses[[2, 4]] == Status.ABSENT.value).all()
        assert_registered(measured, TRUTH, among=kept)
        assert_consistent(measured)

    @pytest.mark.parametrize("search", [True, False])
    def test_a_grain_that_rotated_far(self, search):
        """By 25°: the search registers it; without the search it may be not converged."""
        truth = replace(TRUTH, rotations=TRUTH.rotations.copy())
        truth.rotations[1] = np.deg2rad([10, -18, 15])
        measured = track(grain_set(), radiographs(grain_set(), truth), settings=TrackSettings(search=search))
        if search or measured.statuses[1] == Status.CONVERGED.value:
            assert_registered(measured, truth)
        assert_consistent(measured)

    @pytest.mark.parametrize("value", [0.0, 0.3])
    def test_empty_radiographs(self, value):
        """Nothing on the radiographs: no grain converges, nothing is raised."""
        nothing = Scan(np.full((4, *PANEL), value, np.float32), geometry())
        measured = track(grain_set(2), nothing)
        assert not measured.ok.any()
        assert_consistent(measured)

    def test_without_a_valid_pixel_no_grain_is_fitted(self):
        scan = radiographs(grain_set(), TRUTH)
        measured = track(
            grain_set(), Scan(scan.line_integrals, scan.geometry, np.zeros(scan.line_integrals.shape, bool))
        )
        assert set(measured.statuses) == {Status.NOT_FITTED.value}
        assert_consistent(measured)

    def test_a_view_without_a_visible_grain(self):
        rows = geometry().vectors.copy()
        rows[1, 3:6] += 80 * rows[1, 9:12]
        views = Geometry(rows, PANEL)
        measured = track(grain_set(), radiographs(grain_set(), TRUTH, views=views))
        assert_registered(measured, TRUTH)

    def test_a_single_view(self):
        """A parallel beam does not determine the depth: the grain is poorly determined, with the direction named."""
        grains = grain_set(1)
        truth = motions(grains, (0.05, 0.0, 0.05))
        views = Geometry.parallel([0.0], PANEL, VOXEL)
        measured = track(grains, radiographs(grains, truth, views=views))
        assert measured.statuses[0] == Status.POORLY_DETERMINED.value
        assert "translation along y" in measured.reasons[0]
        assert "translation along x" not in measured.reasons[0]
        u, _ = errors(measured, truth)
        assert np.abs(u[0, [0, 2]]).max() < 0.05
        assert_consistent(measured)


class TestInvalidInput:
    """Wrong input gives statuses other than converged, without exceptions or warnings."""

    pytestmark = pytest.mark.filterwarnings("error")

    @pytest.mark.parametrize(
        "shift", [(0, -500, 0), (0, 0, 5000), (1e12, 0, 0), (0, -40, 0)], ids=["behind", "far", "huge", "at the source"]
    )
    def test_starts_far_off_the_panel(self, shift):
        measured = track(grain_set(), radiographs(grain_set(), TRUTH), motions(grain_set(), shift))
        assert not measured.ok.any()
        assert_consistent(measured)

    @pytest.mark.parametrize("shape", [(1, 1), (52, 2), (1, 64)], ids=str)
    def test_tiny_panels(self, shape):
        grains = grain_set(2)
        measured = track(grains, radiographs(grains, small_motions(grains), views=geometry(shape=shape)))
        assert not measured.ok.any()
        assert_consistent(measured)

    def test_radiographs_of_the_wrong_sign(self):
        scan = radiographs(grain_set(), TRUTH)
        measured = track(grain_set(), Scan(-scan.line_integrals, scan.geometry))
        assert not measured.ok.any()
        assert_consistent(measured)

    def test_a_grain_without_attenuation(self):
        first = grain_set().grains[0]
        nothing = [replace(v, array=0 * v.array) for v in (first.volume, first.fine)]
        empty = replace(first, volume=nothing[0], fine=nothing[1])
        grains = GrainSet((empty, *grain_set().grains[1:]))
        measured = track(grains, radiographs(grains, TRUTH))
        assert measured.statuses[0] == Status.NOT_FITTED.value
        assert_registered(measured, TRUTH, among=slice(1, None))
        assert_consistent(measured)

    def test_grains_of_negative_attenuation(self):
        """Bubbles in a dense fluid whose attenuation was subtracted."""

        def negative(volume):
            return replace(volume, array=-volume.array)

        grains = GrainSet(
            tuple(replace(g, volume=negative(g.volume), fine=negative(g.fine)) for g in grain_set().grains)
        )
        assert_registered(track(grains, radiographs(grains, TRUTH)), TRUTH)

    @pytest.mark.parametrize("projector", ["trilinear", "exact"])
    def test_a_grain_of_one_voxel(self, projector):
        """Its rotation is undetermined, which is reported and disturbs no other grain."""
        others, settings = grain_set(finer=1), TrackSettings(projector=projector)
        array = np.zeros((5, 5, 5), np.float32)
        array[2, 2, 2] = 0.02
        speck = Volume(array, VOXEL, (-1.9, 1.7, -1.9))
        grains = GrainSet((*others.grains, Grain(6, speck, np.array(speck.center))))
        truth = small_motions(grains)
        measured = track(grains, radiographs(grains, truth), settings=settings)
        assert measured.statuses[5] == Status.POORLY_DETERMINED.value
        assert "rotation about any axis" in measured.reasons[5]
        assert_consistent(measured)
        if projector == "trilinear":  # along the exact path grains of 14 voxels are poorly determined anyway
            assert_registered(measured, truth, among=slice(0, 5))

    def test_a_failed_factorisation_is_a_status(self, monkeypatch):
        """An error of the linear algebra library ends one state, not the run of all."""

        def fail(*_):
            raise np.linalg.LinAlgError("SVD did not converge")

        monkeypatch.setattr("grainmotion.solvers.block_cg.damped_solver", fail)
        measured = track(grain_set(), radiographs(grain_set(), TRUTH))
        assert set(measured.statuses) == {Status.NOT_FITTED.value}
        assert "SVD did not converge" in measured.reasons[0]
        assert_consistent(measured)

    def test_a_failed_attempt_keeps_the_first_solution(self, monkeypatch):
        """One grain is missing; the attempts without single grains fail, and the first solution is kept."""
        scan = radiographs(GrainSet(grain_set().grains[1:]), motions(GrainSet(grain_set().grains[1:]), 0.05, 2.0))
        attempts = []

        def fail_later(*arguments):
            attempts.append(1)
            if len(attempts) > 1:
                raise np.linalg.LinAlgError("singular")
            return initialise(*arguments)

        module = sys.modules["grainmotion.tracking.attempt"]
        initialise = module.initialise
        monkeypatch.setattr(module, "initialise", fail_later)
        measured = track(grain_set(), scan)
        assert len(attempts) > 1
        assert Status.NOT_FITTED.value not in measured.statuses

    def test_radiographs_without_noise(self):
        still = motions(grain_set())
        measured = track(grain_set(), radiographs(grain_set(), still, noise=0.0))
        assert_registered(measured, still, voxels=1e-3, degrees=1e-2)


class TestProgressAndReproducibility:
    def test_progress_is_reported(self):
        messages = []
        measured = track(grain_set(), radiographs(grain_set(), TRUTH), progress=lambda *a: messages.append(a))
        assert all(isinstance(m, str) and 0 <= done <= total for m, done, total in messages)
        assert np.all(np.diff([done for _, done, _ in messages]) >= 0)
        assert messages[-1][1] == messages[-1][2]
        fits = [done / total for m, done, total in messages if "free" in m]
        assert 0 < fits[0] < fits[-1] < 0.8  # statuses, covariances and other poses come after
        assert any("one body" in m for m, *_ in messages)
        assert any("free" in m for m, *_ in messages)
        assert len(measured.fit.costs) > 3

    def test_costs_fall_within_a_stage(self):
        costs = track(grain_set(), radiographs(grain_set(), TRUTH)).fit.costs
        for (stage, cost), (next_stage, next_cost) in pairwise(costs):
            if stage == next_stage and "free" in stage:
                assert next_cost < cost * (1 + SIGNIFICANT_COST_CHANGE)
        assert costs[-1][1] < 0.05

    def test_two_runs_give_the_same_motions(self):
        scan = radiographs(grain_set(), TRUTH)
        one, other = track(grain_set(), scan), track(grain_set(), scan)
        np.testing.assert_allclose(one.translations, other.translations, atol=1e-7)

    def test_arguments_are_not_changed(self):
        scan = radiographs(grain_set(), TRUTH)
        images, start = scan.line_integrals.copy(), motions(grain_set(), 0.05)
        voxels = [g.volume.array.copy() for g in grain_set().grains]
        track(grain_set(), scan, start)
        np.testing.assert_array_equal(scan.line_integrals, images)
        np.testing.assert_array_equal(start.translations, 0.05)
        for before, grain in zip(voxels, grain_set().grains, strict=True):
            np.testing.assert_array_equal(before, grain.volume.array)

    @pytest.mark.parametrize(
        "wrong", [{"filters": ()}, {"iterations": 0}, {"tolerance": 0}, {"projector": "joseph"}, {"max_sd_deg": 0}]
    )
    def test_invalid_settings_are_refused(self, wrong):
        with pytest.raises(InputError):
            TrackSettings(**wrong)
