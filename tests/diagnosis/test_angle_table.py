"""Findings from told angles alone: units, coincidences, misprints; none about good scans."""

import numpy as np
import pytest

from grainmotion.diagnosis.angle_table import angle_findings
from grainmotion.model.finding import Level

GOLDEN = 180 * (np.sqrt(5) - 1)
GOOD = {
    "full turn": np.arange(60) * 6.0,
    "half turn": np.linspace(0, 180, 61),
    "decreasing": 360 - np.arange(60) * 6.0,
    "negative": -np.arange(60) * 6.0,
    "interlaced": np.concatenate([np.arange(0, 360, 12), np.arange(6, 360, 12)]).astype(float),
    "interlaced in four turns": np.arange(60) * 24.0 + np.repeat(np.arange(4) * 6, 15),
    "golden ratio": np.arange(60) * GOLDEN,
    "golden ratio, wrapped": np.arange(60) * GOLDEN % 360,
    "wrapped at 360": (350 + np.arange(60) * 6.0) % 360,
    "rounded": np.round(np.arange(200) * 0.225, 1),
    "small steps": np.arange(60) * 0.5,
    "noisy encoder": np.arange(60) * 6.0 + np.random.default_rng(0).normal(0, 0.3, 60),
    "state": np.array([0.0, 45.0, 90.0, 135.0]),
    "state of two": np.array([0.0, 90.0]),
    "state of whole degrees": np.array([0.0, 1.0, 2.0, 3.0]),
    "state, near": np.array([0.0, 1.5, 3.0, 4.5]),
    "opposite views": np.array([0.0, 180.0]),
    "one view": np.array([0.0]),
}


@pytest.mark.parametrize("kind", GOOD)
def test_good_angles_give_no_finding(kind):
    assert angle_findings("reference.geometry.angles_deg", GOOD[kind]) == ()


@pytest.mark.parametrize(
    ("angles", "level", "word"),
    [
        (np.radians(GOOD["full turn"]), Level.ERROR, "radians"),
        (np.radians(GOOD["half turn"]), Level.ERROR, "radians"),
        (np.arange(60) / 60, Level.ERROR, "turns"),
        (np.arange(60) * 6000.0, Level.WARNING, "not in degrees"),
        (np.radians(GOOD["state"]), Level.WARNING, "radians"),
        (np.round(np.radians([10, 55, 100, 145]), 4), Level.WARNING, "radians"),
        (np.zeros(60), Level.ERROR, "same angle"),
        (np.zeros(4), Level.WARNING, "same angle"),
        (np.linspace(0, 360, 60), Level.NOTE, "one direction"),
        (np.array([0.0, 45.0, 45.0, 90.0]), Level.WARNING, "views 1 and 2"),
        (np.round(np.arange(200) * 0.9), Level.WARNING, "too few digits"),
        (np.where(np.arange(60) == 20, 12.0, GOOD["full turn"]), Level.WARNING, "angle of view 20, 12 degrees"),
    ],
)
def test_wrong_angles_are_named(angles, level, word):
    (finding,) = angle_findings("reference.geometry.angles_deg", angles)
    assert finding.level is level
    assert word in str(finding)


def test_remedy_of_the_counted_end_point_is_the_last_angle():
    (finding,) = angle_findings("reference.geometry.angles_deg", np.linspace(0, 360, 60))
    assert "its last angle is 354" in finding.remedy


def test_units_and_misprints_at_any_step():
    """20 seeds: radians and misprints named, none about the same angles in degrees."""
    for seed in range(20):
        rng = np.random.default_rng(seed)
        count, span = int(rng.integers(20, 900)), float(rng.choice([180, 360, -180, 360 * 2]))
        angles = rng.uniform(-90, 90) + np.arange(count) * span / count
        jitter = rng.normal(0, 0.05 * abs(span) / count, count)
        assert angle_findings("a", angles + jitter) == (), seed
        if abs(span) <= 360:
            (finding,) = angle_findings("a", np.radians(angles))
            assert "radians" in finding.fact, seed
        k = int(rng.integers(1, count - 1))
        wrong = np.where(np.arange(count) == k, angles + 100.3, angles)
        (finding,) = angle_findings("a", wrong)
        assert f"angle of view {k}" in finding.fact, seed
