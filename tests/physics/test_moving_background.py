"""A container that moves as one rigid body: its motion is fitted with those of the grains."""

from functools import cache

import numpy as np
import pytest

from few_grains import VOXEL, errors, geometry, grain_set, motions, radiographs, small_motions
from grainmotion.model.grains import GrainSet
from grainmotion.model.scan import Scan
from grainmotion.model.volume import Volume
from grainmotion.projection.grains import simulate_radiographs
from grainmotion.tracking import global_search
from grainmotion.tracking.simulated_annealing import anneal
from grainmotion.tracking.track import TrackSettings, track
from scenes import image_of, one_body

TRUTH = small_motions(grain_set(finer=1))  # the centres are those of all grains
WIDE = geometry(shape=(64, 88))
FIXED = "the radiographs do not show a motion"
SHIFT, ROTATION = np.array([3.0, -1.0, 0.5]) * VOXEL, np.deg2rad([0.5, -0.4, 1.5])


@cache
def wall():
    """A tube that is neither quite round nor uniform, so that its rotation is determined."""
    y, x = (np.mgrid[:72, :72] - 35.5) * VOXEL
    ring = np.clip(0.5 - (np.abs(np.hypot(x, 1.06 * y) - 3.1) - 0.12) / VOXEL, 0, 1)
    array = np.tile(0.5 * ring * (1 + 0.4 * (x > 1.0)), (46, 1, 1))
    array[20:26] *= 1.5
    return Volume(array.astype(np.float32), VOXEL)


def wall_projection(motion=(0, 0, 0, 0, 0, 0)):
    return image_of(wall(), WIDE, motion)


def observed(truth):
    """Radiographs of the moved grains and the moved wall."""
    images = simulate_radiographs(grain_set(), truth, WIDE)
    images += wall_projection((*SHIFT, *ROTATION))
    return Scan(images + 0.01 * np.random.default_rng(2).standard_normal(images.shape), WIDE)


def tracked(moves, settings=None):
    return track(GrainSet(grain_set().grains, one_body(wall(), moves)), observed(TRUTH), settings=settings)


@pytest.fixture(scope="module")
def moving():
    return tracked(True)


class TestMovingBackground:
    def test_its_motion_is_measured(self, moving):
        np.testing.assert_allclose(moving.fit.background[:3], SHIFT, atol=0.03 * VOXEL)
        np.testing.assert_allclose(np.rad2deg(moving.fit.background[3:]), np.rad2deg(ROTATION), atol=0.1)

    def test_the_grains_are_registered(self, moving):
        assert moving.ok.all(), moving.reasons
        u, w = errors(moving, TRUTH)
        assert np.abs(u).max() < 0.06
        assert np.abs(w).max() < 1.0

    def test_a_fixed_background_would_bias_them(self, moving):
        fixed = tracked(False, TrackSettings(search=False))
        assert fixed.fit.background is None
        sizes = [np.sqrt((errors(m, TRUTH)[0] ** 2).mean()) for m in (fixed, moving)]
        assert sizes[0] > 5 * sizes[1]

    def test_a_background_that_did_not_move_is_fixed(self):
        still = motions(grain_set())
        images = simulate_radiographs(GrainSet(grain_set().grains, one_body(wall())), still, WIDE)
        noisy = Scan(images + 0.01 * np.random.default_rng(3).standard_normal(images.shape), WIDE)
        measured = track(
            GrainSet(grain_set().grains, one_body(wall(), True)), noisy, settings=TrackSettings(search=False)
        )
        np.testing.assert_array_equal(measured.fit.background, 0)
        assert any(FIXED in note for note in measured.fit.notes)
        assert np.abs(errors(measured, still)[0]).max() < 0.06

    def test_a_wide_last_filter_is_no_evidence_of_a_motion(self):
        """A wide filter correlates pixels, which must not be taken for a motion."""
        images = simulate_radiographs(GrainSet(grain_set().grains, one_body(wall())), TRUTH, WIDE)
        noisy = Scan(images + 0.01 * np.random.default_rng(3).standard_normal(images.shape), WIDE)
        settings = TrackSettings(search=False, filters=(8.0, 6.0))
        measured = track(GrainSet(grain_set().grains, one_body(wall(), True)), noisy, settings=settings)
        assert any(FIXED in note for note in measured.fit.notes)

    @pytest.mark.parametrize("share", [0.05, 0.1])
    def test_a_small_motion_is_measured(self, monkeypatch, share):
        """A twentieth of the motion, 0.15 voxel, is far more than noise can imitate."""
        monkeypatch.setattr(f"{__name__}.SHIFT", share * SHIFT)
        monkeypatch.setattr(f"{__name__}.ROTATION", share * ROTATION)
        measured = tracked(True, TrackSettings(search=False))
        assert not any(FIXED in note for note in measured.fit.notes)
        np.testing.assert_allclose(measured.fit.background[:3], SHIFT, atol=0.03 * VOXEL)

    def test_a_background_of_noise_is_fixed(self):
        """Free to move, a background of noise would go to some local minimum and shift the grains."""
        rng = np.random.default_rng(5)
        noise = Volume((0.003 * rng.standard_normal((46, 44, 52))).astype(np.float32), VOXEL)
        scan = radiographs(grain_set(), TRUTH)
        free, fixed = (track(GrainSet(grain_set().grains, one_body(noise, moves)), scan) for moves in (True, False))
        np.testing.assert_array_equal(free.fit.background, 0)
        assert free.ok.all(), free.reasons
        np.testing.assert_allclose(free.translations, fixed.translations, atol=2e-3 * VOXEL)

    def test_the_search_uses_its_current_position(self, monkeypatch):
        """Grains are searched on radiographs minus the wall at its current position, not at its first."""
        rng = np.random.default_rng(4)
        directions = rng.normal(size=(2, 5, 3))
        directions /= np.linalg.norm(directions, axis=2, keepdims=True)
        truth = motions(grain_set(), 0.6 * directions[0], 70.0 * directions[1])
        backgrounds = []

        def watched(grains, target, *rest):
            backgrounds.append(target.fixed_background)
            return anneal(grains, target, *rest)

        monkeypatch.setattr(global_search, "anneal", watched)
        measured = track(GrainSet(grain_set().grains, one_body(wall(), True)), observed(truth))
        assert backgrounds
        expected = wall_projection((*SHIFT, *ROTATION))
        assert np.abs(backgrounds[-1] - expected).mean() < 0.2 * np.abs(wall_projection() - expected).mean()
        assert measured.ok.all(), measured.reasons
        assert np.abs(errors(measured, truth)[0]).max() < 0.06
