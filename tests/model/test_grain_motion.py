"""Motions by grain: `motions[label]`, iteration, and the values of a row in degrees."""

from dataclasses import replace

import numpy as np
import pytest

from grainmotion.errors import InputError
from grainmotion.model.motions import Motions
from grainmotion.rotations import rotation_matrix


@pytest.fixture
def motions() -> Motions:
    start = Motions.identity(np.array([4, 9]), np.array([[0.0, 0, 0], [1, 2, 3]]))
    return replace(
        start,
        translations=np.array([[0.0, 0, 0], [0.1, 0.2, 0.3]]),
        rotations=np.deg2rad([[0.0, 0, 0], [0, 0, 30]]),
        covariances=np.tile(np.diag([0.01, 0.04, 0.09, 1, 1, 1]) ** 1.0, (2, 1, 1)),
        statuses=["not-fitted", "converged"],
        reasons=("seen by no view", ""),
    )


def test_a_grain_by_its_label(motions):
    grain = motions[9]
    assert (grain.label, grain.status, grain.ok_translation, grain.ok_rotation) == (9, "converged", True, True)
    assert grain.center == pytest.approx([1, 2, 3])
    assert grain.translation == pytest.approx([0.1, 0.2, 0.3])
    assert grain.rotation_deg == pytest.approx([0, 0, 30])
    assert grain.angle_deg == pytest.approx(30)
    assert grain.translation_sd == pytest.approx([0.1, 0.2, 0.3])
    assert grain.rotation_sd_deg == pytest.approx(np.rad2deg([1, 1, 1]))
    assert grain.matrix == pytest.approx(rotation_matrix(grain.rotation))
    assert grain.strain is None


def test_all_grains_in_order(motions):
    assert [(grain.label, grain.reason) for grain in motions] == [(4, "seen by no view"), (9, "")]
    assert 9 in motions
    assert 5 not in motions
    assert len(motions) == 2


def test_unknown_labels_are_named(motions):
    with pytest.raises(InputError, match="no grain 5"):
        motions[5]


def test_what_is_no_result_is_said(motions):
    assert "translation and rotation" in motions[4]._repr_html_()
    assert "seen by no view" in motions[4]._repr_html_()
    assert repr(motions[9]).startswith("<Motion of grain 9: converged; u = (0.1, 0.2, 0.3) mm")


def test_lists_become_arrays(motions):
    assert motions.statuses.dtype.kind == "U"
    assert motions.ok.tolist() == [False, True]
