"""Usual mistakes in a geometry: each change undoes its mistake exactly."""

from __future__ import annotations

import numpy as np
import pytest

from grainmotion.diagnosis.hypotheses import HYPOTHESES, corrected, stage_angles_deg
from grainmotion.errors import InputError
from grainmotion.model.detector_alignment import DetectorAlignment
from grainmotion.model.geometry import Geometry

PANEL = DetectorAlignment(detector_offset=(0.3, -0.2), axis_offset=0.1)


def cone(angles: np.ndarray, panel: DetectorAlignment = PANEL) -> Geometry:
    return Geometry.cone(angles, (20, 30), 0.5, source_to_axis=100.0, source_to_detector=300.0, panel=panel)


@pytest.mark.parametrize(
    ("name", "nominal", "true"),
    [
        ("angles-negated", np.arange(0, 360, 9.0), -np.arange(0, 360, 9.0)),
        ("angles-in-radians", np.deg2rad(np.arange(0, 360, 9.0)), np.arange(0, 360, 9.0)),
        ("end-point-counted", np.linspace(0, 360, 40), np.arange(40) * 9.0),
        ("end-point-left-out", np.arange(40) * 9.0, np.linspace(0, 360, 40)),
        ("half-the-span", np.arange(0, 360, 9.0), np.arange(0, 180, 4.5)),
        ("twice-the-span", np.arange(0, 180, 4.5), np.arange(0, 360, 9.0)),
        ("order-reversed", np.arange(0, 360, 9.0), np.arange(0, 360, 9.0)[::-1]),
        ("start-at-90", np.arange(0, 360, 90.0), np.arange(0, 360, 90.0) + 90),
        ("start-at-180", np.arange(0, 360, 90.0), np.arange(0, 360, 90.0) + 180),
        ("start-at-270", np.arange(0, 360, 90.0), np.arange(0, 360, 90.0) - 90),
    ],
)
def test_angles(name: str, nominal: np.ndarray, true: np.ndarray):
    changed = corrected(cone(nominal), [name])
    assert changed.vectors == pytest.approx(cone(true).vectors, abs=1e-9)


def test_file_order():
    names = [str(k) for k in range(25)]
    order = np.array([int(name) for name in sorted(names)])
    angles = np.arange(25) * 3.0
    assert corrected(cone(angles), ["sorted-as-text"]).vectors == pytest.approx(cone(angles[order]).vectors)


@pytest.mark.parametrize("name", ["rows-flipped", "columns-flipped", "half-turned", "transposed"])
def test_a_change_of_the_panel_is_its_own_inverse(name: str):
    geometry = cone(np.arange(5.0))
    changed = corrected(geometry, [name])
    assert not np.allclose(changed.vectors, geometry.vectors)
    assert corrected(changed, [name]).vectors == pytest.approx(geometry.vectors)


def test_quarter_turns_undo_each_other():
    geometry = cone(np.arange(5.0))
    back = corrected(geometry, ["quarter-turned", "quarter-turned-back"])
    assert back.vectors == pytest.approx(geometry.vectors)


def test_a_flipped_row_is_the_other_first_row():
    flat = DetectorAlignment(first_row="bottom"), DetectorAlignment(first_row="top")
    bottom, top = (cone(np.arange(5.0), panel) for panel in flat)
    assert corrected(bottom, ["rows-flipped"]).vectors == pytest.approx(top.vectors)


def test_stage_angles_ignore_offsets():
    angles = np.arange(0, 720, 10.0)
    assert stage_angles_deg(cone(angles)) == pytest.approx(angles)


def test_an_unknown_name_is_refused():
    with pytest.raises(InputError, match="known names are angles-negated"):
        corrected(cone(np.arange(3.0)), ["negated"])


def test_every_hypothesis_has_its_words():
    for name, hypothesis in HYPOTHESES.items():
        assert hypothesis.name == name
        assert hypothesis.mistake
        assert hypothesis.remedy
