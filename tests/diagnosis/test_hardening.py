"""Scattered light is told by the curve of line integrals; a scan without it is left alone."""

from __future__ import annotations

import numpy as np
import pytest

import grainmotion as gm
from convex_grains import ConvexGrains
from grainmotion.diagnosis.hardening import check_hardening, corrected_hardening
from grainmotion.simulate import attenuation_volume, hard_case, label_volume

VIEWS = tuple(np.arange(24) * 15.0)
ATTENUATION = 3.3  # times that of the phantom: 0.5 / mm


def hardening(scattered: float, seed: int = 0) -> tuple[gm.Finding, ...]:
    grains = ConvexGrains.random(seed, 10)
    volume, labels = grains.voxels()
    scan = grains.scan(VIEWS, photons=1e7)
    transmission = np.exp(-ATTENUATION * scan.line_integrals)
    scattered_light = scattered * transmission.mean(axis=(1, 2), keepdims=True)
    images = -np.log((transmission + scattered_light) / (1 + scattered))
    return check_hardening(gm.Scan(images, scan.geometry), volume, labels)


def test_no_scatter():
    assert hardening(0.0) == ()


@pytest.mark.parametrize(("scattered", "level"), [(0.05, gm.Level.NOTE), (0.2, gm.Level.WARNING)])
def test_scatter(scattered, level):
    (finding,) = hardening(scattered)
    assert (finding.level, finding.check) == (level, "hardening")
    assert "hardening = 2" in finding.remedy


def test_two_materials_are_no_hardening():
    case = hard_case("materials", 3)
    sample, grid = case.case.sample, case.case.scanner.grid
    scan = case.reference().select(slice(None, 30))
    assert check_hardening(scan, attenuation_volume(sample, grid, 2), label_volume(sample, grid)) == ()


def test_a_curve_that_was_applied_is_told():
    assert corrected_hardening(gm.Hardening()) == ()
    (finding,) = corrected_hardening(gm.Hardening((1.0, 0.1), 1.2, 0.004))
    assert finding.level == gm.Level.NOTE
    assert "12.0 ± 0.4 %" in finding.evidence
    assert "[reconstruct] hardening = false" in finding.remedy
