"""Simulated counts (`simulate.detector`): noise, dark level, flat field, blur, drift."""

import dataclasses
from functools import cache

import numpy as np
import pytest

from grainmotion.errors import InputError
from grainmotion.model.geometry import Geometry
from grainmotion.model.scan import snr
from grainmotion.preprocessing.flat_field import line_integrals_from_counts
from grainmotion.simulate import (
    Ellipsoid,
    Particle,
    Physics,
    Sample,
    line_integrals,
    photons_for_snr,
    record,
    record_line_integrals,
)

GEOMETRY = Geometry.parallel([0, 60], (64, 64), 0.1)
SAMPLE = Sample((Particle(Ellipsoid(np.zeros(3), np.array([2.0, 1.5, 2.5]), np.eye(3)), 0.2),))
FLAWED = Physics(
    photons=50_000, counts_per_photon=0.5, dark=120.0, dark_noise=3.0, flat_variation=0.1, flats=40, darks=40
)


@cache
def clean():
    return line_integrals(SAMPLE, GEOMETRY)


@pytest.mark.parametrize("wanted", [20.0, 50.0])
def test_signal_to_noise_is_as_asked(wanted):
    physics = Physics(photons=photons_for_snr(clean(), wanted))
    one, two = (record_line_integrals(SAMPLE, GEOMETRY, physics, seed) for seed in (1, 2))
    assert snr(one, two) == pytest.approx(wanted, rel=0.03)
    assert np.linalg.norm(clean()) / np.linalg.norm(one.line_integrals - clean()) == pytest.approx(wanted, rel=0.03)


def test_counts_give_the_line_integrals_back():
    recording = record(SAMPLE, GEOMETRY, FLAWED, seed=3)
    scan, report = line_integrals_from_counts(recording.counts, recording.flats, recording.darks, recording.geometry)
    assert report.bad == 0
    error = scan.line_integrals - clean()
    assert abs(error.mean()) < 1e-3
    expected = np.sqrt((np.exp(clean()) / FLAWED.photons).mean())  # photons; flats and dark noise add a little
    assert error.std() == pytest.approx(expected, rel=0.15)


def test_detector_is_the_same_in_every_state():
    flats = [record(SAMPLE, GEOMETRY, FLAWED, seed).flats.mean(axis=0) for seed in (1, 2)]
    assert np.corrcoef(flats[0].ravel(), flats[1].ravel())[0, 1] > 0.99
    assert flats[0].std() / (flats[0].mean() - 120) == pytest.approx(0.1, rel=0.05)


def test_darks_hold_the_dark_level():
    darks = record(SAMPLE, GEOMETRY, FLAWED, 1).darks
    assert darks.mean() == pytest.approx(120, abs=0.1)
    assert darks.std() == pytest.approx(3, rel=0.05)


def test_drift_adds_a_constant_to_the_line_integrals():
    steady = Physics(photons=1e9)
    drifting = dataclasses.replace(steady, gain_drift=0.05)
    offset = (
        record_line_integrals(SAMPLE, GEOMETRY, drifting, 5).line_integrals
        - record_line_integrals(SAMPLE, GEOMETRY, steady, 5).line_integrals
    )
    assert abs(offset.mean()) > 1e-3
    assert offset.std() < 1e-3


def test_blur_smooths_edges_and_conserves_intensity():
    sharp, blurred = (
        np.exp(-record_line_integrals(SAMPLE, GEOMETRY, Physics(photons=1e10, blur=b), 0).line_integrals)
        for b in (0.0, 1.5)
    )
    assert blurred.sum() == pytest.approx(sharp.sum(), rel=1e-4)
    assert np.abs(np.diff(blurred, axis=2)).max() < 0.7 * np.abs(np.diff(sharp, axis=2)).max()


def test_same_seed_same_counts():
    one, two, other = (record(SAMPLE, GEOMETRY, FLAWED, seed).counts for seed in (7, 7, 8))
    assert np.array_equal(one, two)
    assert not np.array_equal(one, other)


def test_impossible_snr_is_refused():
    with pytest.raises(InputError, match="must be > 0"):
        photons_for_snr(clean(), 0)
