"""The first and the last view are told to be one."""

from __future__ import annotations

import numpy as np
import pytest

import grainmotion as gm
from grainmotion.diagnosis.coinciding_views import coinciding_findings
from grainmotion.simulate import Physics, Sample, ellipsoid_particle, record_line_integrals

PANEL = (24, 32)


@pytest.mark.parametrize(("last_angle", "fixes"), [(360.0, []), (354.0, ["end-point-counted"])])
def test_end_point_that_was_counted(last_angle, fixes):
    """The true last angle is a whole turn, or one step less; a whole turn is told."""
    draws = np.random.default_rng(1)
    centers = ((1.5, 0.4, 0.2), (-1.0, 1.0, 0.0))
    sample = Sample(tuple(ellipsoid_particle(draws, 1.6, 0.2).moved(np.eye(3), np.array(c)) for c in centers))
    true, told = (
        gm.Geometry.cone(np.linspace(0, end, 40), PANEL, 0.8, source_to_axis=60, source_to_detector=240)
        for end in (last_angle, 360.0)
    )
    scan = record_line_integrals(sample, true, Physics(photons=2000.0, subsamples=1), 3)
    findings = coinciding_findings(gm.Scan(scan.line_integrals, told), where="reference")
    assert [f.fix for f in findings] == fixes
