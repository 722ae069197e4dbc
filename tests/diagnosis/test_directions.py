"""A full scan that leaves out directions is told; half a turn, full turns and golden-ratio scans leave none out."""

from __future__ import annotations

import numpy as np
import pytest

import grainmotion as gm
from grainmotion.diagnosis.directions import missing_directions

GOLDEN_DEG = 180 * (np.sqrt(5) - 1) / 2


def findings(angles_deg: np.ndarray) -> tuple[gm.Finding, ...]:
    geometry = gm.Geometry.cone(angles_deg, (8, 8), 0.5, source_to_axis=60, source_to_detector=240)
    return missing_directions(geometry, "reference")


@pytest.mark.parametrize("span", [90, 120, 150])
def test_less_than_half_a_turn(span):
    (finding,) = findings(np.linspace(20, 20 + span, 60))
    assert finding.level is gm.Level.WARNING
    assert f"{180 - span} degrees" in finding.fact


@pytest.mark.parametrize(
    "angles_deg",
    [
        np.arange(60) * 3.0,
        np.arange(45) * 4.0 - 90,
        np.arange(60) * 6.0,
        np.arange(12) * 15.0,
        np.arange(40) * GOLDEN_DEG,
        -np.arange(100) * 2.16,
    ],
)
def test_half_a_turn_or_more(angles_deg):
    assert findings(angles_deg) == ()
