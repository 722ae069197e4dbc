"""A sample that creeps or jumps during its full scan is named, with the size of its motion; one at rest is not."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

import grainmotion as gm
from convex_grains import DISTANCES, PANEL, SHAPE, VOXEL, ConvexGrains

VIEWS = 36
FULL_TURN = np.arange(VIEWS) * 360 / VIEWS
EARLY_JUMP = np.where(np.arange(VIEWS) < 12, 0.0, 1.0)
STEADY = np.linspace(0, 1, VIEWS)


def scan_of_moving(path: np.ndarray, seed: int = 1, angles_deg: np.ndarray = FULL_TURN) -> gm.Scan:
    """A full scan of ten grains, all of them moved by ``path`` (views, 3), voxels."""
    grains = ConvexGrains.random(seed, 10)
    steps = zip(angles_deg, path, range(len(path)), strict=True)
    views = [replace(grains, centers=grains.centers + VOXEL * d).scan((a,), seed=k) for a, d, k in steps]
    images = np.concatenate([view.line_integrals for view in views])
    return gm.Scan(images, gm.Geometry.cone(angles_deg, PANEL, 0.5, **DISTANCES))


def check(scan: gm.Scan) -> tuple[gm.Finding, ...]:
    return gm.check_scan(scan, gm.Volume.zeros(SHAPE, VOXEL))


def motion_pixels(finding: gm.Finding) -> np.ndarray:
    return np.array([float(x) for x in re.findall(r"[+-]\d+\.\d+", finding.evidence)])


def test_sample_at_rest():
    assert check(scan_of_moving(np.zeros((VIEWS, 3)))) == ()


def test_a_scan_without_any_attenuation_is_no_moving_sample():
    still = scan_of_moving(np.zeros((VIEWS, 3)))
    found = check(replace(still, line_integrals=still.line_integrals - 1))  # counts with an offset
    assert {f.check for f in found} == {"reference-geometry"}


def test_missing_directions_are_no_motion():
    (finding,) = check(scan_of_moving(np.zeros((VIEWS, 3)), angles_deg=np.linspace(0, 120, VIEWS)))
    assert (finding.level, finding.check) == (gm.Level.WARNING, "reference-geometry")
    assert "leaves out directions over 60 degrees" in finding.fact


@pytest.mark.parametrize("motion", [(0, 0, 1.0), (0.8, -0.6, 0)])
def test_creep(motion):
    (finding,) = check(scan_of_moving(STEADY[:, None] * motion))
    assert (finding.level, finding.check) == (gm.Level.WARNING, "moving-sample")
    assert "crept" in finding.fact
    assert motion_pixels(finding) == pytest.approx(np.array(motion), abs=0.3)


def test_jump():
    (finding,) = check(scan_of_moving(EARLY_JUMP[:, None] * (0.5, 0, -2.5)))
    assert (finding.level, finding.check) == (gm.Level.ERROR, "moving-sample")
    assert "jumped before view 12" in finding.fact
    assert motion_pixels(finding) == pytest.approx(np.array([0.5, 0, -2.5]), abs=0.5)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(10))
def test_rates(seed):
    """Motions of one voxel over the scan, and jumps anywhere."""
    draws = np.random.default_rng(seed)
    direction = draws.normal(size=3)
    direction /= np.linalg.norm(direction)
    view = int(draws.integers(6, VIEWS - 6))
    jump = np.where(np.arange(VIEWS) < view, 0.0, 1.0)
    assert check(scan_of_moving(np.zeros((VIEWS, 3)), seed)) == ()
    (crept,) = check(scan_of_moving(STEADY[:, None] * direction, seed))
    (jumped,) = check(scan_of_moving(jump[:, None] * direction, seed))
    assert (crept.check, jumped.check) == ("moving-sample", "moving-sample")
    assert f"jumped before view {view}" in jumped.fact
