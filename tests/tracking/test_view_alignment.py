"""View alignment: planted corrections of views are measured, but for a motion of the whole sample."""

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

GRAINS = grain_set()
TRUTH = small_motions(GRAINS)
QUICK = TrackSettings(search=False)

PLANTED = np.array([[0.6, -0.4, 0.004], [-0.5, 0.3, -0.003], [0.2, 0.7, 0.002], [-0.3, -0.6, -0.005]])


def misplaced(angles=(0.0, 50.0, 95.0, 140.0), planted=PLANTED, noise=0.01):
    """Radiographs of views that stood elsewhere than is told."""
    views = geometry(angles)
    there = corrected_geometry(
        views, NuisanceMotion(ViewCorrections.of(planted[: len(angles)]), np.zeros(3), np.eye(3))
    )
    return replace(radiographs(GRAINS, TRUTH, views=there, noise=noise), geometry=views)


@cache
def imitated():
    """Corrections ``(12, 4)``, in units of pixels and 0.01 rad, that a motion of the whole sample does as well."""
    scan = misplaced(noise=0.0)
    nothing = np.zeros(scan.line_integrals.shape, np.float32)
    target = Target(
        scan, nothing, "trilinear", 0.7, nuisance=NuisanceModel(view_shift_sd_pixels=1.0, view_angle_sd=0.01)
    )
    return imitated_corrections(StateProblem(GrainArrays.of(GRAINS), target), Pose(TRUTH.translations, TRUTH.matrices))


def without_common_motion(corrections):
    """Corrections less what no view can tell from a motion of the whole sample."""
    units = np.repeat([1.0, 1.0, 0.01], 4)
    flat = corrections.T.ravel() / units
    left = flat - imitated() @ np.linalg.lstsq(imitated(), flat, rcond=None)[0]
    return (left * units).reshape(3, 4).T


def apart_from_the_mean(measured):
    """Largest errors, voxels and degrees, of motions that are known but for one of the whole sample."""
    u, w = errors(measured, TRUTH)
    places = (GRAINS.centers - GRAINS.centers.mean(axis=0)) / VOXEL
    turn = np.deg2rad(w.mean(axis=0))
    rest = u - u.mean(axis=0) - np.cross(turn, places)
    return np.abs(rest).max(), np.abs(w - w.mean(axis=0)).max()


@cache
def with_view_poses():
    return track(GRAINS, misplaced(), settings=replace(QUICK, view_corrections="always"))


class TestPosesOfViews:
    def test_planted_ones_are_found_but_for_a_motion_of_the_sample(self):
        measured = with_view_poses()
        left = without_common_motion(measured.fit.view_corrections.columns - PLANTED)
        assert np.abs(without_common_motion(PLANTED)[:, :2]).max() > 0.3  # pixels
        assert np.abs(left[:, :2]).max() < 0.05
        assert np.abs(np.rad2deg(without_common_motion(PLANTED)[:, 2])).max() > 0.2
        assert np.abs(np.rad2deg(left[:, 2])).max() < 0.1
        assert measured.fit.view_corrections_sd.columns.shape == (4, 3)

    def test_the_grains_are_right_among_each_other(self):
        told = apart_from_the_mean(with_view_poses())
        plain = apart_from_the_mean(track(GRAINS, misplaced(), settings=replace(QUICK, view_corrections="never")))
        assert told[0] < 0.05
        assert told[1] < 0.5
        assert plain[0] > 4 * told[0]

    def test_nothing_is_left_on_the_radiographs(self):
        scan = misplaced()
        assert np.std(residual_images(GRAINS, with_view_poses(), scan)) == pytest.approx(0.01, rel=0.1)

    def test_views_that_stand_where_told_get_no_corrections_to_speak_of(self):
        measured = track(GRAINS, radiographs(GRAINS, TRUTH), settings=replace(QUICK, view_corrections="always"))
        assert np.abs(without_common_motion(measured.fit.view_corrections.columns)[:, :2]).max() < 0.05
        told = apart_from_the_mean(measured)
        assert told[0] < 0.05

    def test_two_views_cannot_tell(self):
        measured = track(GRAINS, misplaced((0.0, 90.0)), settings=replace(QUICK, view_corrections="always"))
        assert measured.fit.view_corrections is None
        assert measured.fit.view_corrections_sd is None
        assert any("view corrections refused" in note and ";" in note for note in measured.fit.notes)
