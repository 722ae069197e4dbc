"""Presence of grains (`tracking.presence`): amplitudes of all at once, and fields through those that are there."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import sparse

from few_grains import grain_set, motions, radiographs, small_motions
from grainmotion.model.motions import Status
from grainmotion.model.pose import Pose
from grainmotion.model.scan import Scan
from grainmotion.objective.data_term import Target
from grainmotion.projection.grain_arrays import GrainArrays
from grainmotion.tracking.multistage import MultistageFit
from grainmotion.tracking.presence import bounded_least_squares, count, none_is_there, take_census
from grainmotion.tracking.settings import TrackSettings
from grainmotion.tracking.track import track

TRUTH = small_motions(grain_set(finer=1))
STILL = Pose(np.zeros((5, 3)), np.tile(np.eye(3), (5, 1, 1)))


def radiographs_of(rows, truth=TRUTH):
    some = grain_set().without([k for k in range(5) if k not in rows])
    moved = replace(motions(some), translations=truth.translations[rows], rotations=truth.rotations[rows])
    return radiographs(some, moved)


def target_of(scan):
    return Target(scan, np.zeros(scan.line_integrals.shape, np.float32), "trilinear", 3.0)


@pytest.mark.parametrize("rows", [[0, 1, 2, 3, 4], [0, 2, 4], [3]])
def test_amplitudes_tell_which_grains_are_there(rows):
    """At the start, with motions of 1.5 voxels and 4 degrees unknown, and a beam that drifted by a tenth."""
    scan = radiographs_of(rows)
    scan = Scan(scan.line_integrals + np.float32(0.1), scan.geometry)
    census = count(GrainArrays.of(grain_set()), target_of(scan), STILL)
    assert list(np.flatnonzero(census.present)) == rows
    np.testing.assert_allclose(census.amplitudes[rows], 1, atol=0.35)


def test_grains_that_lost_attenuation_are_there():
    scan = radiographs(grain_set(), TRUTH, gain=0.6)
    assert count(GrainArrays.of(grain_set()), target_of(scan), STILL).present.all()


def test_a_grain_off_the_panel_is_not_judged():
    away = replace(STILL, translations=np.where([[k == 2] for k in range(5)], 50.0, 0.0))
    assert count(GrainArrays.of(grain_set()), target_of(radiographs_of([0, 1, 3, 4])), away).amplitudes[2] == 1


def test_the_field_follows_the_grains_that_are_there():
    """Two of five are there, and the sample was carried by 6 voxels."""
    far = replace(TRUTH, translations=TRUTH.translations + 0.6)
    fit = MultistageFit.of(grain_set(), radiographs_of([0, 4], far), TrackSettings())
    census = take_census(fit, STILL, [])
    assert list(np.flatnonzero(census.present)) == [0, 4]
    assert np.linalg.norm((census.pose.translations - far.translations)[[0, 4]], axis=1).max() < 0.3


def test_bounded_least_squares_against_its_optimality():
    rng = np.random.default_rng(0)
    a = rng.normal(size=(30, 6))
    gram, products = a.T @ a, rng.normal(size=6) * 20
    low, high = np.zeros(6), np.ones(6)
    x = bounded_least_squares(sparse.csr_array(gram), products, np.full(6, 0.5), low, high)
    slope = gram @ x - products
    assert (slope[x <= 0] >= -1e-6).all()
    assert (slope[x >= 1] <= 1e-6).all()
    np.testing.assert_allclose(slope[(x > 0) & (x < 1)], 0, atol=0.1)


def test_a_grain_that_fell_by_its_size_is_not_absent():
    """Its shadow is not where its neighbours went, but it is there."""
    fallen = replace(TRUTH, translations=TRUTH.translations.copy())
    fallen.translations[3] += [0.0, -1.3, -1.0]
    measured = track(grain_set(), radiographs(grain_set(), fallen))
    assert measured.statuses[3] != Status.ABSENT.value
    assert measured.ok[[0, 1, 2, 4]].all()


def test_all_are_absent_on_radiographs_without_any():
    rng = np.random.default_rng(2)
    scan = radiographs_of([0])
    noise = 0.02 * rng.standard_normal(scan.line_integrals.shape) + 0.01
    measured = track(grain_set(), Scan(noise.astype(np.float32), scan.geometry))
    assert set(measured.statuses) == {Status.ABSENT.value}
    assert not np.isfinite(measured.translations).any()
    assert "none is there" in measured.reasons[0]
    assert not none_is_there(MultistageFit.of(grain_set(), scan, TrackSettings()), STILL)
