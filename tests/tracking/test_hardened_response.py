"""Beam hardening becomes an unknown of a state's response where the state shows it (`tracking.hardened_response`)."""

from dataclasses import replace

import numpy as np
import pytest

from few_grains import grain_set, radiographs, small_motions
from grainmotion.model.scan import Scan
from grainmotion.tracking.hardened_response import Bend
from grainmotion.tracking.track import TrackSettings, track

TRUTH = small_motions(grain_set(3, finer=1))
QUICK = TrackSettings(search=False)


def state(square: float) -> Scan:
    """Radiographs whose line integrals p are p + square p², with noise."""
    clean = radiographs(grain_set(3), TRUTH, noise=0.0)
    p = clean.line_integrals
    noise = 0.01 * np.random.default_rng(5).standard_normal(p.shape)
    return Scan((p + square * p**2 + noise).astype(np.float32), clean.geometry)


def rms_error(motions) -> float:
    return float(np.sqrt(np.mean((motions.translations - TRUTH.translations) ** 2)) / grain_set(3).voxel_size)


def test_a_clean_state_has_a_gain_only():
    assert track(grain_set(3), state(0.0), settings=QUICK).fit.response.polynomial.shape[1] == 1


def test_a_state_that_shows_hardening_gets_its_square_and_better_motions():
    measured = track(grain_set(3), state(-0.1), settings=QUICK)
    assert measured.fit.response.polynomial[0] == pytest.approx([1.0, -0.1], abs=0.01)
    assert rms_error(measured) < 0.7 * rms_error(track(grain_set(3), state(-0.1), settings=replace(QUICK, hardening=1)))


def test_a_known_gain_is_kept():
    measured = track(grain_set(3), state(-0.1), settings=replace(QUICK, gain="none"))
    assert measured.fit.response.polynomial.shape[1] == 1


def test_a_square_of_the_wrong_sign_is_no_hardening():
    assert track(grain_set(3), state(0.1), settings=QUICK).fit.response.polynomial.shape[1] == 1


def test_a_bend_that_the_views_do_not_share_is_no_hardening():
    assert Bend(0.05, 0.03, 0.002).is_hardening
    assert not Bend(0.05, 0.13, 0.2).is_hardening
    assert not Bend(0.001, 0.03, 0.002).is_hardening
    assert not Bend(0.05, 0.03, np.inf).is_hardening
