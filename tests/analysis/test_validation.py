"""Comparison with true motions (`analysis.validation`): errors of composed motions, pairing, failures."""

import dataclasses

import numpy as np
import pytest

from grainmotion.analysis.validation import compare
from grainmotion.errors import InputError
from grainmotion.model.motions import Motions, Status
from grainmotion.rotations import recenter, rotation_matrix, rotation_vector


def make(centers, translations, rotations, labels=None):
    n = len(centers)
    start = Motions.identity(np.arange(1, n + 1) if labels is None else labels, centers)
    return dataclasses.replace(
        start,
        translations=np.asarray(translations, dtype=float),
        rotations=np.asarray(rotations, dtype=float),
        statuses=np.full(n, Status.CONVERGED.value, dtype="<U20"),
    )


def subset(motions, rows):
    names = (
        "labels",
        "centers",
        "translations",
        "rotations",
        "covariances",
        "statuses",
        "residuals",
        "iterations",
    )
    return dataclasses.replace(
        motions, reasons=("",) * len(rows), **{name: getattr(motions, name)[rows] for name in names}
    )


@pytest.fixture
def truth():
    rng = np.random.default_rng(0)
    centers = np.stack(np.meshgrid(*[np.arange(3) * 5.0] * 3), -1).reshape(-1, 3) + rng.uniform(-1, 1, (27, 3))
    return make(centers, rng.normal(size=(27, 3)), 0.3 * rng.normal(size=(27, 3)))


def test_truth_has_no_error_against_itself(truth):
    result = compare(truth, truth, 0.1)
    assert result.translation_rms < 1e-12
    assert result.rotation_rms_deg < 1e-5
    assert (result.failures, result.missing, len(result.spurious)) == (0, 0, 0)


def test_same_motion_about_another_centre_has_no_error(truth):
    rng = np.random.default_rng(1)
    centers = truth.centers + 0.3 * rng.normal(size=(27, 3))
    moved = recenter(truth.matrices, truth.translations, truth.centers, centers)
    result = compare(make(centers, moved, truth.rotations), truth, 0.1)
    assert np.abs(result.translation_errors).max() < 1e-12
    assert result.failures == 0


def test_error_is_the_motion_composed_after_the_true_one(truth):
    rng = np.random.default_rng(2)
    rotation_errors, shift_errors = 0.02 * rng.normal(size=(27, 3)), 0.01 * rng.normal(size=(27, 3))
    measured = make(
        truth.centers,
        truth.translations + shift_errors,
        rotation_vector(rotation_matrix(rotation_errors) @ truth.matrices),
    )
    result = compare(measured, truth, 0.1)
    assert np.allclose(result.rotation_errors_deg, np.rad2deg(rotation_errors))
    assert np.allclose(result.translation_errors, shift_errors)
    assert result.translation_rms_voxels == pytest.approx(np.sqrt((shift_errors**2).mean()) / 0.1)


def test_grains_are_paired_independent_of_order_and_labels(truth):
    order = np.random.default_rng(3).permutation(27)
    measured = make(truth.centers[order], truth.translations[order], truth.rotations[order], labels=np.arange(100, 127))
    result = compare(measured, truth, 0.1)
    assert np.array_equal(order[result.matches], np.arange(27))
    assert result.translation_rms < 1e-12


def test_missing_and_spurious_grains_are_counted(truth):
    rows = np.delete(np.arange(27), [4, 20])
    measured = make(
        np.concatenate([truth.centers[rows], [[50.0, 50.0, 50.0]]]),
        np.concatenate([truth.translations[rows], np.zeros((1, 3))]),
        np.concatenate([truth.rotations[rows], np.zeros((1, 3))]),
    )
    result = compare(measured, truth, 0.1)
    assert np.flatnonzero(result.matches < 0).tolist() == [4, 20]
    assert (result.missing, result.failures, result.spurious.tolist()) == (2, 2, [25])
    assert np.isnan(result.translation_errors[4]).all()
    assert result.translation_rms < 1e-12


def test_failures_are_large_errors_or_not_converged(truth):
    translations, rotations = truth.translations.copy(), truth.rotations.copy()
    translations[0, 0] += 0.11  # 1.1 voxels
    translations[1, 0] += 0.09
    rotations[2] = rotation_vector(rotation_matrix([0, 0, np.deg2rad(6)]) @ truth.matrices[2])
    measured = make(truth.centers, translations, rotations)
    statuses = measured.statuses.copy()
    statuses[3] = Status.POORLY_DETERMINED.value
    measured = dataclasses.replace(measured, statuses=statuses)
    assert np.flatnonzero(compare(measured, truth, 0.1).failed).tolist() == [0, 2, 3]
    assert np.flatnonzero(compare(measured, truth).failed).tolist() == [2, 3]
    strict = compare(measured, truth, 0.1, limit_voxels=0.5, limit_deg=10)
    assert np.flatnonzero(strict.failed).tolist() == [0, 1, 3]


def test_a_round_grain_counts_by_its_translation(truth):
    rotations = truth.rotations.copy()
    rotations[3] += 0.5
    measured = make(truth.centers, truth.translations, rotations)
    statuses = measured.statuses.copy()
    statuses[3] = Status.POORLY_DETERMINED.value
    measured = dataclasses.replace(measured, statuses=statuses, ok_rotation=np.arange(27) != 3)
    result = compare(measured, truth, 0.1)
    assert not result.failed_translation.any()
    assert np.flatnonzero(result.failed_rotation).tolist() == [3]
    assert result.rotation_rms_deg < 1e-6


def test_without_measured_grains_all_are_missing(truth):
    result = compare(subset(truth, []), truth, 0.1)
    assert result.missing == result.failures == 27
    assert np.isnan(result.translation_rms)


def test_empty_truth_is_refused(truth):
    with pytest.raises(InputError, match="holds no grain"):
        compare(truth, subset(truth, []))
