"""Views that the geometry says are one, and whose radiographs differ: an end point that was counted."""

from __future__ import annotations

import numpy as np

from grainmotion.diagnosis.hypotheses import HYPOTHESES
from grainmotion.diagnosis.view_consistency import relative_norm
from grainmotion.model.finding import Check, Finding, Level
from grainmotion.model.scan import Scan
from grainmotion.preprocessing.binning import binned_scan, binning_factor

COINCIDING_CHECK: Check = "coinciding-views"
END_POINT_FIX = "end-point-counted"
COINCIDING_COLUMNS = 16
"""Columns to which radiographs are binned before they are compared, which averages the noise."""
SAME_VIEW_SHARE = 0.8
"""Two radiographs of one view differ by less than this share of what neighbouring views differ by.

Sound scans whose end point counts gave 0.03-0.62 (SNR 10-50, 24-120 views), an end point that was counted 1.02-1.15.
"""
MIN_VIEWS_COMPARED = 5
"""Fewer have no neighbours to compare with."""
MIN_GROWTH = 1.3
"""Views two steps apart differ by so many times what neighbours differ by, else all of it may be noise."""


def coinciding_findings(scan: Scan, *, where: str) -> tuple[Finding, ...]:
    """An error where the first and the last view are told to be one, and their radiographs differ as neighbours do."""
    vectors = scan.geometry.vectors
    scale = float(np.abs(vectors).max())
    if len(scan) < MIN_VIEWS_COMPARED or not np.allclose(vectors[0], vectors[-1], atol=1e-6 * scale):
        return ()
    factor = binning_factor(scan.geometry.shape, COINCIDING_COLUMNS)
    views = np.array([0, 1, 2, len(scan) - 2, len(scan) - 1])
    first, second, third, before, last = binned_scan(scan, factor, views).line_integrals
    step = (relative_norm(second - first, first) + relative_norm(last - before, first)) / 2
    apart = relative_norm(last - first, first)
    if apart < SAME_VIEW_SHARE * step or relative_norm(third - first, first) < MIN_GROWTH * step:
        return ()
    evidence = f"they differ by {apart:.3f} of their norm, neighbouring views by {step:.3f}"
    fact = "the first and the last radiograph are told to be of the same view and are not: probably "
    mistake = HYPOTHESES[END_POINT_FIX]
    remedy = mistake.remedy
    return (Finding(Level.ERROR, COINCIDING_CHECK, where, fact + mistake.mistake, evidence, remedy, END_POINT_FIX),)
