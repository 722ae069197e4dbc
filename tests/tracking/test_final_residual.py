"""The residual that tracking returns equals that of simulating its motions again (`tracking.track`)."""

from dataclasses import replace

import numpy as np
import pytest

from few_grains import geometry, grain_set, motions, radiographs, small_motions
from grainmotion.analysis.residual_images import residual_images
from grainmotion.model.grains import GrainSet
from grainmotion.model.scan import Scan
from grainmotion.model.volume import Volume
from grainmotion.projection.volumes import project
from grainmotion.tracking.track import PAPER, TrackSettings, track_with_residual
from scenes import one_body

TRUTH = small_motions(grain_set(finer=1))
QUICK = TrackSettings(search=False)
ROUNDING = 4e-6  # of single precision, in line integrals of about 1.4


def wall() -> Volume:
    """A dense tube around the grains."""
    _, y, x = np.indices((40, 64, 64))
    r = np.hypot(y - 31.5, x - 31.5)
    return Volume(np.where((r > 28) & (r < 31), 0.5, 0.0).astype(np.float32), grain_set().voxel_size)


def assert_residual_equals_simulation(grains, scan, settings):
    measured, residual = track_with_residual(grains, scan, settings=settings)
    expected = residual_images(grains, measured, scan, projector=settings.projector)
    np.testing.assert_allclose(residual, expected, atol=ROUNDING)
    return residual


@pytest.mark.parametrize(
    "settings",
    [
        QUICK,
        PAPER,
        replace(QUICK, gain="view", trend="linear", hardening=2),
        replace(QUICK, view_corrections="always"),
        replace(QUICK, weights="photons", loss="huber"),
    ],
    ids=["default", "paper", "response", "views", "weights"],
)
def test_residual_equals_simulation_for_several_settings(settings):
    truth = motions(grain_set(), 0.02, 0.5) if settings is PAPER else TRUTH
    scan = radiographs(grain_set(), truth, gain=1.0 if settings is PAPER else 1.05)
    assert np.std(assert_residual_equals_simulation(grain_set(), scan, settings)) < 0.03


def test_masked_pixels_are_nan():
    scan = radiographs(grain_set(), TRUTH)
    valid = np.ones(scan.line_integrals.shape, bool)
    valid[:, 10:14, 20:25] = False
    residual = assert_residual_equals_simulation(grain_set(), Scan(scan.line_integrals, scan.geometry, valid), QUICK)
    np.testing.assert_array_equal(np.isnan(residual), ~valid)


def test_residual_without_a_missing_grain():
    remaining = grain_set().without([2])
    truth = replace(
        small_motions(remaining), translations=TRUTH.translations[[0, 1, 3, 4]], rotations=TRUTH.rotations[[0, 1, 3, 4]]
    )
    assert_residual_equals_simulation(grain_set(), radiographs(remaining, truth), TrackSettings())


@pytest.mark.parametrize("moves", [True, False])
def test_residual_with_a_background(moves):
    scan = radiographs(grain_set(), TRUTH)
    scan = replace(scan, line_integrals=scan.line_integrals + project(wall(), geometry()))
    assert_residual_equals_simulation(GrainSet(grain_set().grains, one_body(wall(), moves)), scan, QUICK)


def test_there_is_no_residual_if_a_grain_has_no_motion():
    scan = radiographs(grain_set(), TRUTH, views=geometry(shape=(52, 22)))
    measured, residual = track_with_residual(grain_set(), scan, settings=QUICK)
    assert np.isnan(measured.translations).any()
    assert residual is None
