"""View alignment (`tracking.view_alignment`): corrections of views, but for a motion of the whole sample."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from few_grains import VOXEL, errors, geometry, grain_set, radiographs, small_motions
from grainmotion.analysis.residual_images import residual_images
from grainmotion.model.pose import NuisanceMotion, Pose, ViewCorrections
from grainmotion.objective.data_term import Target
from grainmotion.objective.nuisance_motions import NuisanceModel, corrected_geometry
from grainmotion.objective.residual import StateProblem
from grainmotion.projection.grain_arrays import GrainArrays
from grainmotion.tracking.track import TrackSettings, track
from grainmotion.tracking.view_alignment import imitated_corrections

TRUTH = small_motions(grain_set(finer=1))
QUICK = TrackSettings(search=False)

TRUE_CORRECTIONS = np.array([[0.6, -0.4, 0.004], [-0.5, 0.3, -0.003], [0.2, 0.7, 0.002], [-0.3, -0.6, -0.005]])


def misaligned(angles=(0.0, 50.0, 95.0, 140.0), corrections=TRUE_CORRECTIONS, noise=0.01):
    """Radiographs whose true views differ from the nominal ones."""
    views = geometry(angles)
    true_views = corrected_geometry(
        views, NuisanceMotion(ViewCorrections.of(corrections[: len(angles)]), np.zeros((0, 3)), np.zeros((0, 3, 3)))
    )
    return replace(radiographs(grain_set(), TRUTH, views=true_views, noise=noise), geometry=views)


@cache
def imitated():
    """Corrections ``(12, 4)``, in units of pixels and 0.01 rad, that a motion of the whole sample imitates."""
    scan = misaligned(noise=0.0)
    nothing = np.zeros(scan.line_integrals.shape, np.float32)
    target = Target(
        scan, nothing, "trilinear", 0.7, nuisance=NuisanceModel(view_shift_sd_pixels=1.0, view_angle_sd=0.01)
    )
    return imitated_corrections(
        StateProblem(GrainArrays.of(grain_set()), target), Pose(TRUTH.translations, TRUTH.matrices)
    )


def without_common_motion(corrections):
    """Corrections without the part that a motion of the whole sample imitates."""
    units = np.repeat([1.0, 1.0, 0.01], 4)
    flat = corrections.T.ravel() / units
    rest = flat - imitated() @ np.linalg.lstsq(imitated(), flat, rcond=None)[0]
    return (rest * units).reshape(3, 4).T


def errors_but_for_a_common_motion(measured):
    """Largest errors, voxels and degrees, of motions that are determined but for one of the whole sample."""
    u, w = errors(measured, TRUTH)
    positions = (grain_set().centers - grain_set().centers.mean(axis=0)) / VOXEL
    rotation = np.deg2rad(w.mean(axis=0))
    rest = u - u.mean(axis=0) - np.cross(rotation, positions)
    return np.abs(rest).max(), np.abs(w - w.mean(axis=0)).max()


@cache
def with_view_poses():
    return track(grain_set(), misaligned(), settings=replace(QUICK, view_corrections="always"))


class TestViewAlignment:
    def test_true_corrections_are_determined_but_for_a_motion_of_the_sample(self):
        measured = with_view_poses()
        correction_errors = without_common_motion(measured.fit.view_corrections.columns - TRUE_CORRECTIONS)
        assert np.abs(without_common_motion(TRUE_CORRECTIONS)[:, :2]).max() > 0.3  # pixels
        assert np.abs(correction_errors[:, :2]).max() < 0.05
        assert np.abs(np.rad2deg(without_common_motion(TRUE_CORRECTIONS)[:, 2])).max() > 0.2
        assert np.abs(np.rad2deg(correction_errors[:, 2])).max() < 0.1
        assert measured.fit.view_corrections_sd.columns.shape == (4, 3)

    def test_relative_motions_of_grains_are_accurate(self):
        aligned = errors_but_for_a_common_motion(with_view_poses())
        plain = errors_but_for_a_common_motion(
            track(grain_set(), misaligned(), settings=replace(QUICK, view_corrections="never"))
        )
        assert aligned[0] < 0.05
        assert aligned[1] < 0.5
        assert plain[0] > 4 * aligned[0]

    def test_the_residual_is_the_noise(self):
        scan = misaligned()
        assert np.std(residual_images(grain_set(), with_view_poses(), scan)) == pytest.approx(0.01, rel=0.1)

    def test_corrections_of_aligned_views_are_small(self):
        measured = track(
            grain_set(), radiographs(grain_set(), TRUTH), settings=replace(QUICK, view_corrections="always")
        )
        assert np.abs(without_common_motion(measured.fit.view_corrections.columns)[:, :2]).max() < 0.05
        largest = errors_but_for_a_common_motion(measured)
        assert largest[0] < 0.05

    def test_two_views_are_not_aligned(self):
        measured = track(grain_set(), misaligned((0.0, 90.0)), settings=replace(QUICK, view_corrections="always"))
        assert measured.fit.view_corrections is None
        assert measured.fit.view_corrections_sd is None
        assert any("view corrections refused" in note and ";" in note for note in measured.fit.notes)
